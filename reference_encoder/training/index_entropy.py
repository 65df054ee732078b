"""The index network trained along with the scene (paper §3.4, §3.5; SPEC §10.5, §10.6).

Its rows are the indices of the scene as a file would hold it now, taken again every so often; steps on them are those
of `networks.index_training`, so that what is learnt is the integers of the file all along. No gradient leaves it:
indices have none (paper: L_feat trains the predictor). What acts on codewords is their price when they are chosen.

    joint = JointIndexModel()
    joint.refresh(scene)             now and then, from half of the run on
    l_feat = joint.step()            with every iteration, or every few
    learned = joint.finish(scene)    in the end
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
import torch

from reference_encoder.training.fixed_order import one_thread
from reference_encoder.training.networks.dataset import IndexRows, describe_inputs, index_rows
from reference_encoder.training.networks.grid import BinaryGrid, fit_box, hybrid_levels, wave_grid
from reference_encoder.training.networks.index_training import Examples, IndexOptimizer, build, last_epochs, train
from reference_encoder.training.networks.layers import NetworkShape, shape_for
from reference_encoder.training.networks.model import export_network
from reference_encoder.training.optimizer import moments, restore_moments
from reference_encoder.tuning import CONTEXT, CONTEXT_LATENTS, INDEX_LEARNING_RATE, INDEX_ROWS, LARGEST_BATCH
from scarfmt.coding.writer import QuantisedScene
from scarfmt.neural.grid import GridBox, GridLevel
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import Codebooks


@dataclass(frozen=True)
class Lesson:
    """What an index network learns from, until indices are taken again.

    Attributes:
        rows, books: samples, and the codewords that they choose from.
        shape: of the network.
        anchors: of the scene.
    """

    rows: IndexRows
    books: Codebooks
    shape: NetworkShape
    anchors: int

    def begin(self, grid: BinaryGrid | None, classes: int | None, seed: int) -> IndexOptimizer:
        """A network that knows nothing, and its optimiser.

        Args:
            grid: learned along with the network.
            classes: how many inputs, the first, it sees beside the grid; None for all.
            seed: of its first weights.
        """
        features = 0 if grid is None else sum(level.features for level in grid.levels)
        model = build(self.rows, self.books, self.shape, seed, features)
        if classes is not None:
            model.first.theta.data[:, classes : self.rows.inputs.shape[1]] = 0
        return IndexOptimizer(model, Examples(self.rows, grid), INDEX_LEARNING_RATE)


class JointIndexModel:
    """An index network that learns while the scene does.

    Args:
        paper: the paper's network, which sees the class and a learned hybrid grid alone: two GRU layers and attention.
            Else one GRU layer sees the class, the anchor's own attributes, means over cells of anchors decoded before
            and the position in fixed waves.
        seed: of everything random.

    Attributes:
        seconds: that the last step took.
    """

    def __init__(self, paper: bool = False, seed: int = 0) -> None:
        self.paper, self._seed = paper, seed
        self._grid: BinaryGrid | None = None
        self._lesson: Lesson | None = None
        self._descent: IndexOptimizer | None = None
        self._draw = np.random.default_rng(seed)
        self.seconds = 0.0

    def state(self) -> dict[str, Any]:
        """For a checkpoint: what is learnt, and from what."""
        grid, descent = self._grid, self._descent
        return {
            "lesson": self._lesson,
            "parameters": None if descent is None else descent.model.state_dict(),
            "moments": None if descent is None else moments(descent.optimiser),
            "draw": self._draw.bit_generator.state,
            "grid": None
            if grid is None
            else {
                "box": [*grid.box.origin, grid.box.extent_bits],
                "levels": [astuple(level) for level in grid.levels],
                "tables": [table.detach().clone() for table in grid.tables],
            },
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a checkpoint."""
        self._draw.bit_generator.state = state["draw"]
        self._lesson, self._descent, self._grid = state["lesson"], None, None
        if state["grid"] is not None:
            *origin, extent_bits = state["grid"]["box"]
            levels = tuple(GridLevel(*level) for level in state["grid"]["levels"])
            self._grid = BinaryGrid(GridBox((origin[0], origin[1], origin[2]), extent_bits), levels)
            for table, values in zip(self._grid.tables, state["grid"]["tables"], strict=True):
                table.data.copy_(values)
        if self._lesson is not None:
            self._descent = self._lesson.begin(self._grid, None, self._seed)
            self._descent.model.load_state_dict(state["parameters"])
            restore_moments(self._descent.optimiser, state["moments"])

    @property
    def hash_bits(self) -> float:
        """L_hash of the paper: bits of the learned grid, 0 without one."""
        return 0.0 if self._grid is None else float(self._grid.coded_bits().detach())

    def refresh(self, scene: QuantisedScene) -> None:
        """Take the indices of a scene; what has been learnt goes on.

        Only biases of codewords start again from their uses: codewords may have other numbers now. Latents have to keep
        their coordinates (`vq_features.Coordinates`).

        Args:
            scene: as a file would hold it; nothing happens without indices.
        """
        if scene.codebooks is not None and scene.model.max_stages:
            self._prepare(scene)

    def step(self) -> float:
        """One step on a batch of rows; L_feat in bits an anchor of the scene, 0 while there is nothing to learn."""
        if self._lesson is None or self._descent is None:
            return 0.0
        examples = self._descent.examples
        count = min(LARGEST_BATCH, len(examples))
        chosen = torch.from_numpy(self._draw.integers(0, len(examples), count))
        expected = examples.sent * count / len(examples)
        began = time.monotonic()
        with one_thread():
            bits = self._descent.step(chosen, expected)
        self.seconds = time.monotonic() - began
        return bits * examples.sent * examples.scale / max(self._lesson.anchors, 1)

    def finish(self, scene: QuantisedScene) -> QuantisedScene | None:
        """The final scene, as a file would hold it, with the network, trained to its end; None without indices."""
        if scene.codebooks is None or not scene.model.max_stages:
            return None
        scene, inputs, descent = self._prepare(scene)
        train(descent.model, descent.examples, *last_epochs(len(descent.examples)), self._seed)
        assert scene.codebooks is not None
        network = export_network(descent.model, inputs, scene.codebooks)
        return replace(scene, network=network, grid=scene.grid if self._grid is None else self._grid.export())

    def _prepare(self, scene: QuantisedScene) -> tuple[QuantisedScene, Inputs, IndexOptimizer]:
        """The scene, layers neural; what the network sees; and its optimiser, from now on."""
        # All indices are to be coded by the network, which the scene does not have yet.
        neural = tuple(replace(row, neural=max(row.stages) > 0) for row in scene.model.layers)
        context = scene.model.context if scene.predictors else CONTEXT
        scene = replace(scene, model=replace(scene.model, context=context, layers=neural))
        assert scene.codebooks is not None
        dimension, classes, own = scene.codebooks.dimension, neural[-1].class_count, not self.paper
        latents = min(CONTEXT_LATENTS, dimension) if own else 0
        rows = index_rows(scene, own, latents, INDEX_ROWS, self._seed)
        anchors = sum(map(len, scene.contents))
        if own:
            waves = wave_grid(fit_box(rows.positions)[0])
            rows = replace(rows, inputs=np.concatenate([rows.inputs, waves.features(rows.positions)], axis=1))
            scene, width = replace(scene, grid=waves), waves.width
        else:
            # The file has a decoded context all the same: such inputs are 0 in rows, and their weights have to be.
            rows.inputs[:, classes:] = 0
            if self._grid is None:
                box, extent = fit_box(rows.positions)
                self._grid = BinaryGrid(box, hybrid_levels(anchors, extent), seed=self._seed)
            width = sum(level.features for level in self._grid.levels)
        assert scene.codebooks is not None
        indices = sum(int(scene.model.stages(len(neural), content.classes).sum()) for content in scene.contents)
        shape = shape_for(indices, dimension, 2 if self.paper else 1, self.paper)
        self._lesson = Lesson(rows, scene.codebooks, shape, anchors)
        descent = self._lesson.begin(self._grid, classes if self.paper else None, self._seed)
        if self._descent is not None:
            _hand_on(self._descent, descent)
        self._descent = descent
        return scene, describe_inputs(scene.model, own, latents, width), descent


def _hand_on(before: IndexOptimizer, descent: IndexOptimizer) -> None:
    """Go on with what was learnt, but for biases of codewords."""
    known = before.model.state_dict()
    for name, parameter in descent.model.named_parameters():
        if name in known and known[name].shape == parameter.shape and not name.endswith("beta"):
            parameter.data.copy_(known[name])
    if _sizes(before.optimiser) == _sizes(descent.optimiser):
        restore_moments(descent.optimiser, moments(before.optimiser))


def _sizes(optimiser: torch.optim.Optimizer) -> list[list[torch.Size]]:
    return [[parameter.shape for parameter in group["params"]] for group in optimiser.param_groups]
