"""The index network trained along with the scene (paper §3.4, §3.5; SPEC §10.5, §10.6).

Its rows are the indices of the scene as a file would hold it now, taken again every so often; steps on them are those
of `reference_encoder.networks.train`, so that what is learnt is the integers of the file all along. No gradient leaves
it: indices have none (paper: L_feat trains the predictor). What acts on codewords is their price when they are chosen.

    joint = JointIndexModel(IndexOptions.named("gru", "waves"))
    joint.refresh(scene)             now and then, from half of the run on
    l_feat = joint.step()            with every iteration, or every few
    written = joint.file(quantised, encode_options)     in the end
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch

from reference_encoder.decide.assemble import Quantised
from reference_encoder.networks.candidates import Learned, affordable_predictors, arranged, with_neural_layers
from reference_encoder.networks.dataset import ContextOptions
from reference_encoder.networks.decode_time import class_counts
from reference_encoder.networks.defaults import shape_for, training_for
from reference_encoder.networks.export import export
from reference_encoder.networks.file_costs import mechanisms
from reference_encoder.networks.grid import BinaryGrid, Lookup, default_levels, fit_box, wave_grid
from reference_encoder.networks.model import IndexModel
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.train import Descent, Examples, TrainOptions, build, one_thread, train
from reference_encoder.networks.view import NetworkView
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.pipeline import Written, best_file
from reference_encoder.training.options import CONTEXTS, ENTROPY_MODELS
from reference_encoder.tuning import CONTEXT_LATENTS, INDEX_LEARNING_RATE, LARGEST_BATCH, ROUND_LEARNING_RATE
from scarfmt.coding.writer import QuantisedScene, Report, silent, write_scene
from scarfmt.engines import best_engine
from scarfmt.errors import InvalidInput
from scarfmt.neural.grid import GridBox, GridLevel
from scarfmt.scene.codebooks import Codebooks

_GRIDS = {"grid2d3d": "hybrid", "grid3d": "3d"}
"""Learned grids by context: kinds of `networks.grid.default_levels`."""
_EFFORT = 2
"""Whose sample of rows and length of training hold."""


@dataclass(frozen=True)
class IndexOptions:
    """The coder of the indices and its inputs.

    Attributes:
        entropy: "static", tables alone; "mlp", a perceptron over the context that knows the stage but no index of an
            earlier one; "gru"; "gru+attention".
        context: "decoded", the class, the anchor's own attributes and means over cells of anchors decoded before;
            "waves", that and the position in fixed waves; "grid3d" and "grid2d3d", the class and a learned grid alone,
            as in the paper; "none", the class alone.
        gru_layers: 1..4.
        always: kept also where the file gets larger; for ablations and where a user named it.
        seed: of everything random.
    """

    entropy: str = "gru"
    context: str = "waves"
    gru_layers: int = 1
    always: bool = False
    seed: int = 0

    @classmethod
    def named(cls, entropy: str | None, context: str | None, preset: str = "default", seed: int = 0) -> IndexOptions:
        """By what a user said, None for what the preset has: "paper" is a GRU of two layers, attention, hybrid grid.

        Raises:
            InvalidInput: ``input-options`` for what the format cannot say, or does not exist.
        """
        paper, said = preset == "paper", entropy is not None or context is not None
        if entropy is None:
            entropy = "gru+attention" if paper else "gru"
        if context is None:
            context = "none" if entropy == "static" else ("grid2d3d" if paper else "waves")
        made = cls(entropy, context, 2 if paper and entropy.startswith("gru") else 1, paper or said, seed)
        made.check()
        return made

    def check(self) -> None:
        """Check names, and that they go together.

        Raises:
            InvalidInput: ``input-options``.
        """
        for name, choices in (("entropy", ENTROPY_MODELS), ("context", CONTEXTS)):
            if getattr(self, name) not in choices:
                message = f"{getattr(self, name)!r} is not one of {', '.join(choices)}"
                raise InvalidInput("input-options", message, field=name)
        if self.entropy == "static" and self.context != "none":
            message = f"static tables see no context: leave out {self.context!r}, or let a network code the indices"
            raise InvalidInput("input-options", message, field="context")
        if not 1 <= self.gru_layers <= 4 or (self.entropy == "mlp" and self.gru_layers > 1):
            message = f"{self.gru_layers} recurrent layers: 1..4 are possible, and 1 without recurrence"
            raise InvalidInput("input-options", message, field="gru_layers")

    @property
    def sees_neighbours(self) -> bool:
        """Whether own attributes and means over cells are inputs."""
        return self.context in ("decoded", "waves")

    def shape(self, indices: int, dimension: int) -> NetworkShape:
        """The network for a scene of so many indices and latent dimensions."""
        shape = shape_for(indices, dimension, self.entropy == "gru+attention")
        return replace(shape, gru_layers=self.gru_layers, recurrent=self.entropy != "mlp")


@dataclass(frozen=True)
class _Material:
    """The training data of a network.

    Attributes:
        scene: in the order of clusters, layers neural; `books` are its codebooks.
        sizes: of the clusters of both books.
        view: without a learned grid.
        descent: the network, its examples and its optimiser.
        lookup: what a learned grid reads for each row.
    """

    scene: QuantisedScene
    books: Codebooks
    sizes: tuple[tuple[int, ...], ...]
    view: NetworkView
    descent: Descent
    lookup: Lookup | None


class JointIndexModel:
    """An index network that learns while the scene does.

    Attributes:
        options: see `IndexOptions`.
    """

    def __init__(self, options: IndexOptions) -> None:
        options.check()
        self.options = options
        self._grid: BinaryGrid | None = None
        self._material: _Material | None = None
        self._known: dict[str, torch.Tensor] = {}
        self._draw = np.random.default_rng(options.seed)

    def state(self) -> dict[str, Any]:
        """The learnt values in plain values and tensors, for a checkpoint. Averages of Adam are left out."""
        known = self._known if self._material is None else dict(self._material.descent.model.named_parameters())
        grid = self._grid
        return {
            "parameters": {name: parameter.detach().clone() for name, parameter in known.items()},
            "draw": self._draw.bit_generator.state,
            "grid": None if grid is None else {
                "box": [*grid.box.origin, grid.box.extent_bits],
                "levels": [astuple(level) for level in grid.levels],
                "tables": [table.detach().clone() for table in grid.tables],
            },
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a checkpoint; the next `refresh` brings the indices."""
        self._material, self._known = None, dict(state["parameters"])
        self._draw.bit_generator.state = state["draw"]
        self._grid = None
        if state["grid"] is not None:
            *origin, extent_bits = state["grid"]["box"]
            levels = tuple(GridLevel(*level) for level in state["grid"]["levels"])
            self._grid = BinaryGrid(GridBox((origin[0], origin[1], origin[2]), extent_bits), levels)
            for table, values in zip(self._grid.tables, state["grid"]["tables"], strict=True):
                table.data.copy_(values)

    @property
    def hash_bits(self) -> float:
        """L_hash of the paper: bits of the learned grid, 0 without one."""
        return 0.0 if self._grid is None else float(self._grid.coded_bits().detach())

    def refresh(self, scene: QuantisedScene) -> None:
        """Take the indices of a scene; what has been learnt goes on.

        Only biases of codewords start again from their uses: codewords may have other numbers now. Latents have to keep
        their coordinates (`fixed_latents.export`).

        Args:
            scene: as a file would hold it; nothing happens without indices, or where tables code them.
        """
        if scene.codebooks is None or not scene.model.max_stages or self.options.entropy == "static":
            return
        before, self._material = self._material, self._prepared(scene, scene.codebooks)
        if before is not None:
            self._known = dict(before.descent.model.named_parameters())
        descent = self._material.descent
        _carry(self._known, descent.model)
        if before is not None and _sizes(before.descent.optimiser) == _sizes(descent.optimiser):
            descent.optimiser.load_state_dict(before.descent.optimiser.state_dict())

    def step(self) -> float:
        """One step on a batch of rows; L_feat in bits an anchor of the scene, 0 while there is nothing to learn."""
        if self._material is None:
            return 0.0
        descent = self._material.descent
        examples, count = descent.examples, min(LARGEST_BATCH, len(descent.examples))
        chosen = torch.from_numpy(self._draw.integers(0, len(examples), count))
        expected = examples.sent * count / len(examples)
        with one_thread():
            bits = descent.step(chosen, expected)
        return bits * examples.sent * examples.scale / max(sum(map(len, self._material.scene.contents)), 1)

    def finish(
        self, scene: QuantisedScene, report: Report = silent, training: TrainOptions | None = None
    ) -> Learned | None:
        """The final scene with the network, trained to its end; None without indices, or with tables alone.

        Args:
            report: told (stage, fraction done).
            training: of that end; None for what a scene of this size is worth.
        """
        self.refresh(scene)
        made = self._material
        if made is None or scene.codebooks is None or self.options.entropy == "static":
            return None
        model, rows = made.descent.model, made.descent.examples.rows
        if training is None:
            training = training_for(len(rows), _EFFORT, self.options.seed)
            training = replace(training, learning_rate=ROUND_LEARNING_RATE)
        learns = partial(report, "entropy network")
        trained = train(
            rows, made.books, made.sizes, model.shape, training, learns, model, self._grid, made.lookup
        )
        view = made.view if self._grid is None else replace(made.view, grid=self._grid.export())
        network = export(trained.model, view.columns(made.scene.model), made.books)
        scene = replace(made.scene, network=network, grid=view.grid)
        return Learned(scene, trained.model, view, training, made.sizes, trained.bits)

    def file(self, plain: Quantised, options: EncodeOptions, report: Report = silent) -> Written:
        """The file of a scene, with this network where it was asked for or the file is smaller; see `best_file`."""
        if self.options.entropy == "static" or not self.options.always:
            return best_file(plain, options, report, lambda scene, _most_ns: self.finish(scene, report))
        static = write_scene(plain.scene, report, best_engine())
        scene = affordable_predictors(plain.scene, options, report) or plain.scene
        learned = self.finish(scene, report)
        if learned is None:
            return Written(static, plain.scene)
        data = write_scene(learned.scene, report, best_engine())
        return Written(data, learned.scene, mechanisms(static, learned.scene, data))

    def _prepared(self, scene: QuantisedScene, books: Codebooks) -> _Material:
        scene = with_neural_layers(scene)
        context, sees = scene.model.context, self.options.sees_neighbours
        latents = min(CONTEXT_LATENTS, books.dimension) if sees else 0
        seen = ContextOptions(context.passes_log2, context.occupancies, own=sees, latents=latents)
        view = NetworkView(seen, None, blind=not sees)
        rows, positions = view.placed_rows(scene, EFFORTS[_EFFORT].training.rows, self.options.seed)
        if self.options.context == "waves":
            view = replace(view, grid=wave_grid(fit_box(positions)[0]))
            rows = view.with_features(scene.model, rows, positions)
        elif self.options.context in _GRIDS and self._grid is None:
            box, extent = fit_box(positions)
            anchors = sum(map(len, scene.contents))
            levels = default_levels(anchors, extent, _GRIDS[self.options.context])
            self._grid = BinaryGrid(box, levels, seed=self.options.seed)
        scene, rows, sizes = arranged(scene, rows)
        assert scene.codebooks is not None
        stages, counts = scene.model.layers[-1].stages, class_counts(scene.contents)
        shape = self.options.shape(int(counts[: len(stages)] @ np.array(stages)), books.dimension)
        features = 0 if self._grid is None else sum(level.features for level in self._grid.levels)
        model = build(rows, scene.codebooks, sizes, shape, self.options.seed, features)
        if view.blind:
            ignored = slice(view.columns(scene.model).classes, rows.inputs.shape[1])
            model.first.theta.data[:, ignored] = 0
        lookup = None if self._grid is None else self._grid.lookup(positions)
        training = TrainOptions(learning_rate=INDEX_LEARNING_RATE, seed=self.options.seed)
        descent = Descent(model, Examples(rows, self._grid, lookup), training)
        return _Material(scene, scene.codebooks, sizes, view, descent, lookup)


def _carry(known: Mapping[str, torch.Tensor], model: IndexModel) -> None:
    """Give a model the known parameters of the same name and size, but for the biases of codewords."""
    for name, parameter in model.named_parameters():
        if name in known and known[name].shape == parameter.shape and not name.endswith("beta"):
            parameter.data.copy_(known[name].detach())


def _sizes(optimiser: torch.optim.Optimizer) -> list[list[torch.Size]]:
    return [[parameter.shape for parameter in group["params"]] for group in optimiser.param_groups]
