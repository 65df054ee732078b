"""The bytes of offsets with a context, and the quality with coarser steps: tables of docs/decisions/0038-offsets.md.

    python -m benchmarks.offsets scene.scar CAPTURE

It prints its tables and writes nothing. Bits are entropies under one table a component and context, and 7 bits for each
entry that a table has. Steps are tried on a finished file: of each of its layers, offsets are rounded to cells 3 and 9
times as wide, nothing else changes, and pictures are compared with the photos that were held out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.photos import held_out, measured
from benchmarks.report import table
from reference_encoder.training.capture import Photo
from scarfmt.api import decode_scene, inspect, truncate
from scarfmt.arrays import F64, I32, I64
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.tile import TileContent
from scarfmt.container.schema import Stream
from scarfmt.container.source import BytesSource
from scarfmt.engines import best_engine
from scarfmt.scene.gaussians import AnchorModel

COARSER = (1, 3, 9)
_ENTRY_BITS = 7
_CLASSES = 8
"""Number of classes of equally many values that a number becomes when it is a context."""


def kilobytes(values: I64, contexts: I64 | None = None) -> float:
    """Kilobytes of (n, 3) offsets under a table for each component and each of (n, 3) contexts, tables included."""
    contexts = np.zeros_like(values) if contexts is None else contexts
    bits = 0.0
    for column, numbers in zip(values.T, contexts.T, strict=True):
        _, pairs = np.unique(np.stack([numbers, column]), axis=1, return_counts=True)
        _, alone = np.unique(numbers, return_counts=True)
        bits += float((alone * np.log2(alone)).sum() - (pairs * np.log2(pairs)).sum()) + _ENTRY_BITS * len(pairs)
    return bits / 8e3


def classes(values: F64 | I32 | I64) -> I64:
    """(n, ...) numbers 0.._CLASSES - 1 of equally many values each."""
    edges = np.unique(np.quantile(values, np.linspace(0, 1, _CLASSES + 1)[1:-1]))
    return np.asarray(np.searchsorted(edges, values), np.int64)


def offsets(data: bytes) -> Iterator[tuple[str, float]]:
    """The possible contexts, and the kilobytes that all offsets of a file take with each."""
    reader = SceneReader(BytesSource(data), engine=best_engine())
    models = reader.models()
    channel, scale = (models.model.channel_index(stream) for stream in (Stream.OFFSETS, Stream.SCALE))
    assert channel is not None
    assert scale is not None
    contents = [content for _, content in reader.tiles(models)]
    on = np.concatenate([content.slot_layers for content in contents]) > 0
    every = np.concatenate([content.values[channel] for content in contents]).astype(np.int64)
    yield "none", kilobytes(every[on])
    scaling = np.concatenate([content.values[scale] for content in contents])
    for name, numbers in known(contents, scaling, on, every):
        yield name, kilobytes(every[on], np.broadcast_to(numbers, every.shape)[on])


def known(
    contents: Sequence[TileContent], scaling: I32, on: NDArray[np.bool_], every: I64
) -> Iterator[tuple[str, I64]]:
    """The values that a decoder knows before an offset, as contexts that broadcast to (N, K, 3)."""
    layers = np.concatenate([content.slot_layers for content in contents])
    yield "class of the anchor", np.concatenate([content.classes for content in contents])[:, None, None]
    yield "layer that turns the slot on", layers[:, :, None]
    yield "number of the slot", np.arange(every.shape[1])[None, :, None]
    yield "slots of the anchor", on.sum(axis=1)[:, None, None]
    for component in range(scaling.shape[1]):
        yield f"scaling {component}", classes(scaling[:, component])[:, None, None]
    shown = every * on[:, :, None]
    count = np.maximum(np.cumsum(on, axis=1) - on, 1)[:, :, None]
    yield "mean of the slots before", classes((np.cumsum(shown, axis=1) - shown) / count)
    sizes = np.abs(shown)
    yield "their mean size", classes((np.cumsum(sizes, axis=1) - sizes) / count)


def coarser(data: bytes, photos: Sequence[Photo]) -> Iterator[tuple[int, int, float, float]]:
    """Layers, how many times wider cells are, kilobytes of offsets without context, and PSNR (dB)."""
    widths = np.array(channel_widths(data), np.float64)
    for layers in range(1, int(inspect(data)["layer_count"]) + 1):
        model = decode_scene(truncate(data, layers))
        assert isinstance(model, AnchorModel)
        exact = np.rint(model.offsets / widths).astype(np.int64)
        on = np.ones(exact.shape[:2], np.bool_) if model.slot_mask is None else model.slot_mask
        for times in COARSER:
            rounded = np.rint(exact / times).astype(np.int64)
            changed = replace(model, offsets=(rounded * times * widths).astype(np.float32))
            found = measured(changed, len(data), photos, {})
            yield layers, times, kilobytes(rounded[on]), found.psnr_db


def channel_widths(data: bytes) -> tuple[float, ...]:
    """Cells of the offsets of a file."""
    model = SceneReader(BytesSource(data)).models().model
    channel = model.channel_index(Stream.OFFSETS)
    assert channel is not None
    return model.channels[channel].first_width


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("file", type=Path, help="a .scar of the anchor profile")
    parser.add_argument("capture", type=Path, help="the photos that it was trained from")
    parser.add_argument("--resolution", type=int, help="longest side of the photos, pixels")
    said = parser.parse_args(arguments)
    data, photos = said.file.read_bytes(), held_out(said.capture, said.resolution)
    contexts = [[name, f"{size:.1f}"] for name, size in offsets(data)]
    sys.stdout.write(table(("context of offsets", "kB"), contexts) + "\n")
    steps = [[str(layers), str(times), f"{size:.1f}", f"{db:.2f}"] for layers, times, size, db in coarser(data, photos)]
    sys.stdout.write(table(("layers", "cells wider by", "kB", "PSNR, dB"), steps, text_columns=0))


if __name__ == "__main__":
    main(sys.argv[1:])
