"""The effect of training the index network in less than float32, on one synthetic problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from reference_encoder.networks.dataset import IndexRows
from reference_encoder.networks.shape import NetworkShape
from reference_encoder.networks.train import Examples, TrainOptions, measure, train
from scarfmt.scene.codebooks import Codebooks

PRECISIONS = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
_ANCHORS, _COLUMNS, _WORDS, _STAGES, _DIMENSION = 6000, 24, 64, 3, 12
_SHAPE = NetworkShape(hidden=16, middle=32, mixer=32, codeword_dims=_DIMENSION)
_OPTIONS = TrainOptions(epochs=10, batch=128, learning_rate=0.025, patience=0.0)


def problem() -> tuple[IndexRows, Codebooks]:
    """Anchors whose latent is a linear function of their inputs, with noise, quantised by a random residual VQ."""
    rng = np.random.default_rng(11)
    inputs = np.rint(rng.normal(size=(_ANCHORS, _COLUMNS)) * 60)
    falling = 300 / (1 + np.arange(_DIMENSION))
    told = inputs @ rng.normal(size=(_COLUMNS, _DIMENSION)) / 300
    latent = (told + rng.normal(size=(_ANCHORS, _DIMENSION))) * falling
    words = [np.rint(rng.normal(size=(_WORDS, _DIMENSION)) * falling * part).astype(np.int64) for part in (1.2, 0.6)]
    codes, rest = np.empty((_ANCHORS, _STAGES), np.int16), latent
    for stage in range(_STAGES):
        book = words[min(stage, 1)]
        codes[:, stage] = ((rest[:, None] - book) ** 2).sum(axis=2).argmin(axis=1)
        rest = rest - book[codes[:, stage]]
    zeros = np.zeros(_ANCHORS, np.int64)
    places = np.zeros((_ANCHORS, 2), np.int64)
    rows = IndexRows(
        inputs.astype(np.int16), zeros, zeros, zeros + _STAGES, codes, places, _ANCHORS, _ANCHORS * _STAGES
    )
    return rows, Codebooks(words[0], words[1])


def measure_training() -> list[dict[str, Any]]:
    """Bits an index of networks trained with matrix products in each precision; the file's are exact integers."""
    torch.set_num_threads(1)
    rows, books = problem()
    examples, indices, out = Examples(rows), _ANCHORS * _STAGES, []
    for quantised in (True, False):
        options = TrainOptions(**{**_OPTIONS.__dict__, "quantised": quantised})
        for name, dtype in PRECISIONS.items():
            with torch.autocast("cpu", dtype, enabled=dtype != torch.float32):
                model = train(rows, books, ((), ()), _SHAPE, options).model
                trained = float(measure(model, examples, quantised).sum()) / indices
            finite = all(bool(torch.isfinite(parameter).all()) for parameter in model.parameters())
            filed = float(measure(model, examples, True, True).sum()) / indices if finite else float("nan")
            kind = "integers, straight-through" if quantised else "floating point, rounded afterwards"
            out.append({"precision": name, "network": kind, "trained": trained, "filed": filed})
    return out


def training_rows(found: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Cells of the table; lost: against float32 of the same kind, in the file."""
    base = {run["network"]: run["filed"] for run in found if run["precision"] == "float32"}
    rows = []
    for run in found:
        lost = f"{run['filed'] / base[run['network']] - 1:+.1%}" if np.isfinite(run["filed"]) else "no network"
        figures = [f"{run[key]:.3f}" if np.isfinite(run[key]) else "not finite" for key in ("trained", "filed")]
        rows.append([run["precision"], run["network"], *figures, lost])
    return rows
