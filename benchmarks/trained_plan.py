"""The trainings of docs/trained.md: what each row of each study changes of one base, and no other thing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from benchmarks.report import table
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.recipe import RECIPES, Recipe

Changes = Mapping[str, Any]
BASES: dict[str, dict[str, Any]] = {
    "rvq": {"entropy": "gru", "context": "waves"},
    "paper": {"entropy": "gru+attention", "context": "grid2d3d"},
}
"""By preset that ablations start from: what it stands for, said aloud, so that the network is kept in any case."""


@dataclass(frozen=True)
class Row:
    """One variant of a study.

    Attributes:
        label: as tables show it.
        options: members of TrainOptions that it changes.
        recipe: members of Recipe that it changes.
    """

    label: str
    options: Changes = field(default_factory=dict)
    recipe: Changes = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """Variants that are compared.

    Attributes:
        question: what it answers.
        rows: its variants.
        by_layer: whether tables show every layer, not the first and the last alone.
    """

    question: str
    rows: tuple[Row, ...]
    by_layer: bool = False


_SCALARS: Changes = {"preset": "default", "entropy": None, "context": None}
_STATIC: Changes = {"entropy": "static", "context": "none"}


_PRICES = (1.0, 2.0, 4.0, 8.0)
"""Prices of a bit in each of four layers, the last first, relative to that of the last (`run.begun`)."""


def _sweep(option: str, values: Sequence[float]) -> tuple[Row, ...]:
    return tuple(Row(f"{value:g}", {**_SCALARS, option: value}) for value in values)


STUDIES: dict[str, Study] = {
    "entropy": Study(
        "Entropy model of the indices",
        (
            Row("static tables", _STATIC),
            Row("MLP", {"entropy": "mlp"}),
            Row("GRU", {"entropy": "gru"}),
            Row("GRU + attention", {"entropy": "gru+attention"}),
        ),
    ),
    "quantiser": Study(
        "Residual or one vector quantiser",
        (
            Row("RVQ, 4 stages of 1,024", recipe={"stages": 4, "codewords": 1024}),
            Row("VQ, 1 of 4,096", recipe={"stages": 1, "codewords": 4096}),
            Row("RVQ, 2 of 64: as many bits as the VQ", recipe={"stages": 2, "codewords": 64}),
            Row("none: latents number by number", _SCALARS),
        ),
    ),
    "estimator": Study(
        "Gradient through the quantiser",
        (
            Row("rotation trick", recipe={"estimator": "rotation"}),
            Row("straight-through", recipe={"estimator": "straight-through"}),
        ),
    ),
    "curriculum": Study(
        "Curriculum or cold start",
        (Row("curriculum"), Row("cold start", recipe={"curriculum": "cold"})),
    ),
    "grid": Study(
        "Spatial context of the indices",
        (
            Row("hybrid 2D + 3D grid", {"context": "grid2d3d"}),
            Row("3D grid", {"context": "grid3d"}),
            Row("fixed waves and decoded neighbours", {"context": "waves"}),
            Row("none", {"context": "none"}),
        ),
    ),
    "lambda-ssim": Study("Share of SSIM in the loss", _sweep("lambda_ssim", (0.1, 0.2, 0.3, 0.4)), by_layer=True),
    "single": Study(
        "Layers, or a file for each rate alone",
        (
            Row("four layers", _SCALARS),
            *(Row(f"one layer, lambda {times:g}", {**_SCALARS, "layers": 1, "lambda_": times}) for times in _PRICES),
        ),
        by_layer=True,
    ),
    "lambda": Study("Weight of the bytes", _sweep("lambda_", (0.25, 0.5, 1.0, 2.0, 4.0)), by_layer=True),
}
"""By name. The first five are the ablations of the paper (§5), the sixth its figure over lambda_ssim."""


@dataclass(frozen=True)
class Training:
    """One training of the plan.

    Attributes:
        options: what a user can ask.
        recipe: what no user can.
    """

    options: TrainOptions
    recipe: Recipe

    @property
    def name(self) -> str:
        """The name among the results of the scene, equal for rows that ask for the same training."""
        plain, usual = TrainOptions(), RECIPES[self.options.preset]
        said = [
            f"{name.rstrip('_')}={getattr(self.options, name)}"
            for name in ("entropy", "context", "layers", "last_layer", "lambda_", "lambda_ssim")
            if getattr(self.options, name) != getattr(plain, name)
        ]
        said += [f"{name}={value}" for name, value in vars(self.recipe).items() if value != getattr(usual, name)]
        return ", ".join([" ".join([self.options.preset, *said]), f"seed {self.options.seed}"])


def training(row: Row, base: str, length: Changes, seed: int) -> Training:
    """The training of a row.

    Args:
        row: of a study.
        base: of `BASES`.
        length: `iterations` or `minutes` of TrainOptions, and its `device`.
        seed: of everything random.
    """
    options = TrainOptions(**{"preset": base, **BASES[base], **row.options, **length, "seed": seed})
    return Training(options, replace(RECIPES[options.preset], **row.recipe))


def trainings(names: Sequence[str], base: str, length: Changes, seeds: int) -> list[Training]:
    """All trainings of some studies, each once: one seed of every row, then the next."""
    found: dict[str, Training] = {}
    for seed, row in ((seed, row) for seed in range(seeds) for name in names for row in STUDIES[name].rows):
        one = training(row, base, length, seed)
        found.setdefault(one.name, one)
    return list(found.values())


def plan_table() -> str:
    """A Markdown table of what each row of each study changes."""
    return table(("study", "row", "changes"), list(_rows()), text_columns=3)


def _rows() -> Iterator[tuple[str, str, str]]:
    for name, study in STUDIES.items():
        for number, row in enumerate(study.rows):
            changes = [*row.options.items(), *row.recipe.items()]
            said = [f"`{key.rstrip('_')}={value}`" for key, value in changes if value is not None]
            yield f"`{name}`" if number == 0 else "", row.label, ", ".join(said) or "nothing"
