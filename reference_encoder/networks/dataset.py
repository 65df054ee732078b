"""The inputs of the index network for every anchor and layer of a scene, equal to those of the decoder.

A row is an anchor in a layer that gives it at least one RVQ stage (SPEC §10.5). Its inputs depend on the class,
on the anchor's own attributes and, through cell means, on anchors decoded earlier: those of layers before, and
those of earlier passes of the same tile-layer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import I16, I64
from scarfmt.codecs.channels import coarsen
from scarfmt.coding.tile import TileContent
from scarfmt.container.directory import TileFrame
from scarfmt.container.morton import deinterleave
from scarfmt.engines import best_engine
from scarfmt.neural.context import CellMeans, count_features, depth_shifts, passes
from scarfmt.neural.context_operations import fine
from scarfmt.scene.codebooks import Codebooks
from scarfmt.scene.model import SceneModel

# The arrays of IndexRows, in order.
Part = tuple[I16, I64, I64, I64, I16, I64]

CLASS_VALUE = 64
"""Input of the column of an anchor's class; all other class columns are 0."""
ATTRIBUTE_SHIFT = 6
_WIDEST = 2047
"""Inputs are clamped to this at most: activations have at most 12 bits."""


@dataclass(frozen=True)
class ContextOptions:
    """The inputs that the network has beside those of a hash grid.

    Attributes:
        passes_log2, occupancies: of the file (SPEC §10.2).
        own: whether an anchor's own attributes are inputs.
        latents: latent dimensions whose cell means are inputs.
        latent_shift: right shift of those means.
    """

    passes_log2: int = 2
    occupancies: tuple[int, ...] = (64, 12, 3)
    own: bool = True
    latents: int = 8
    latent_shift: int = 0


@dataclass(frozen=True)
class IndexRows:
    """Rows of training samples.

    Attributes:
        inputs: (n, width) int16, not yet clamped to the network's own activations.
        classes: (n,) int64.
        before, after: (n,) int64 stages received before and after the row's layer; before < after.
        codes: (n, M) int16 codeword numbers of all stages.
        places: (n, 2) int64 tile number and anchor number in its content.
        total: rows of the whole scene; more than n for a sample.
        symbols: indices coded in the whole scene.
    """

    inputs: I16
    classes: I64
    before: I64
    after: I64
    codes: I16
    places: I64
    total: int
    symbols: int

    def __len__(self) -> int:
        return len(self.classes)

    def take(self, chosen: I64) -> IndexRows:
        """The rows `chosen`, as a sample of the same scene."""
        return IndexRows(
            self.inputs[chosen],
            self.classes[chosen],
            self.before[chosen],
            self.after[chosen],
            self.codes[chosen],
            self.places[chosen],
            self.total,
            self.symbols,
        )


def lattice_positions(rows: IndexRows, contents: Sequence[TileContent], frames: Sequence[TileFrame]) -> I64:
    """(n, 3) int64 lattice coordinates of the rows' cell centres, for a hash grid (SPEC §10.6)."""
    out = np.empty((len(rows), 3), np.int64)
    for number, (content, frame) in enumerate(zip(contents, frames, strict=True)):
        here = np.flatnonzero(rows.places[:, 0] == number)
        local = deinterleave(content.codes[rows.places[here, 1]]).astype(np.int64)
        out[here] = np.array(frame.corner, np.int64) + (local << frame.shift) + ((1 << frame.shift) >> 1)
    return out


def index_rows(
    model: SceneModel,
    contents: Sequence[TileContent],
    bits: Sequence[int],
    books: Codebooks,
    options: ContextOptions,
    most: int | None = None,
    seed: int = 0,
) -> IndexRows:
    """Samples of a scene: all rows, or about `most` of them chosen by `seed`.

    Args:
        contents: tiles at the model's last layer, anchors in normative order.
        bits: local lattice bits of each tile.
    """
    total, symbols = _totals(model, contents)
    share = 1.0 if most is None or most >= total else most / max(total, 1)
    draw = np.random.default_rng(seed)
    parts = [
        part
        for number, (content, depth) in enumerate(zip(contents, bits, strict=True))
        for part in _tile_rows(model, content, depth, books, options, share, draw, number)
    ]
    parts.append(_no_rows(input_width(model, options), model.max_stages))
    inputs, classes, before, after, codes, places = (np.concatenate(column) for column in zip(*parts, strict=True))
    return IndexRows(inputs, classes, before, after, codes, places, total, symbols)


def _no_rows(width: int, stages: int) -> Part:
    none = np.zeros(0, np.int64)
    return np.zeros((0, width), np.int16), none, none, none, np.zeros((0, stages), np.int16), np.zeros((0, 2), np.int64)


def input_width(model: SceneModel, options: ContextOptions) -> int:
    """Inputs of a row, without those of a hash grid."""
    columns = sum(model.channels[index].components for index in model.attributes)
    depth = columns + options.latents + 1
    return model.layers[-1].class_count + options.own * columns + len(options.occupancies) * depth


def _totals(model: SceneModel, contents: Sequence[TileContent]) -> tuple[int, int]:
    """(rows, indices) of the whole scene."""
    classes = np.concatenate([content.classes for content in contents])
    rows = sum(int((model.stages(k, classes) > model.stages(k - 1, classes)).sum()) for k in _layers(model))
    return rows, int(model.stages(len(model.layers), classes).sum())


def _layers(model: SceneModel) -> range:
    return range(1, len(model.layers) + 1)


def _tile_rows(
    model: SceneModel,
    content: TileContent,
    bits: int,
    books: Codebooks,
    options: ContextOptions,
    share: float,
    draw: np.random.Generator,
    number: int,
) -> Iterator[Part]:
    """The rows of one tile, layer by layer, pass by pass."""
    for layer in _layers(model):
        known = np.flatnonzero(content.classes < model.layers[layer - 1].class_count)
        # Stable: anchors of equal code keep their order in the tile.
        order = known[np.argsort(content.codes[known], kind="stable")]
        classes = content.classes[order]
        before, after = model.stages(layer - 1, classes), model.stages(layer, classes)
        group = np.flatnonzero(before < after)
        if not len(group):
            continue
        wanted = group[draw.random(len(group)) < share] if share < 1 else group
        inputs = index_inputs(model, layer, content, order, bits, books, options, wanted)
        places = np.stack([np.full(len(wanted), number, np.int64), order[wanted]], axis=1)
        yield inputs, classes[wanted], before[wanted], after[wanted], content.indices[order[wanted]], places


def index_inputs(
    model: SceneModel,
    layer: int,
    content: TileContent,
    order: I64,
    bits: int,
    books: Codebooks,
    options: ContextOptions,
    wanted: I64,
) -> I16:
    """(w, width) int16 inputs of the anchors `wanted` in `layer`, as the decoder will compute them (SPEC §10.5).

    Args:
        order: (n,) anchors known after `layer`, by ascending (code, index).
        wanted: (w,) ascending positions in `order` of anchors that get a stage in `layer`.
    """
    classes = content.classes[order]
    before, after = model.stages(layer - 1, classes), model.stages(layer, classes)
    attributes = attribute_values(model, layer, content, order)
    own = np.minimum(np.maximum(attributes[wanted] >> ATTRIBUTE_SHIFT, -_WIDEST), _WIDEST)
    every = np.arange(model.layers[-1].class_count)
    parts = [(classes[wanted, None] == every) * CLASS_VALUE]
    if options.own:
        parts.append(own)
    if options.occupancies:
        codes = content.codes[order]
        cells = CellMeans(codes, depth_shifts(codes, bits, options.occupancies))
        latents = [_latents(content, order, books, stages, options.latents) for stages in (before, after)]
        parts.append(_means(cells, attributes, latents, (before, after), options, wanted))
    return np.concatenate(parts, axis=1).astype(np.int16)


def _means(
    cells: CellMeans,
    attributes: I64,
    latents: Sequence[I64],
    stages: tuple[I64, I64],
    options: ContextOptions,
    wanted: I64,
) -> I64:
    """(w, depths * (A + L + 1)) int64 inputs from cell means, pass by pass."""
    before, after = stages
    columns = attributes.shape[1]
    out = np.empty((len(wanted), cells.depths, columns + options.latents + 1), np.int64)
    place = np.full(len(before), -1)
    place[wanted] = np.arange(len(wanted))
    known, group = np.flatnonzero(before > 0), np.flatnonzero(before < after)
    sums = best_engine().cell_sums(cells, columns + options.latents)
    sums.add(known, np.concatenate([attributes, latents[0]], axis=1)[known])
    values = np.concatenate([attributes, latents[1]], axis=1)
    for part in passes(len(group), options.passes_log2):
        members = group[part]
        here = members[place[members] >= 0]
        means, counts = sums.around(here)
        whole, rows = means.astype(np.int64), place[here]
        out[rows, :, :columns] = whole[:, :, :columns] >> ATTRIBUTE_SHIFT
        out[rows, :, columns:-1] = _round_shift(whole[:, :, columns:], options.latent_shift)
        out[rows, :, -1] = count_features(counts)
        # An anchor refined in this layer now counts twice: as it was before the layer and as it is after it.
        sums.add(members, values[members])
    return np.clip(out, -_WIDEST, _WIDEST).reshape(len(wanted), cells.depths * (columns + options.latents + 1))


def _round_shift(values: I64, shift: int) -> I64:
    return (values + (1 << shift >> 1)) >> shift


def attribute_values(model: SceneModel, layer: int, content: TileContent, order: I64) -> I64:
    """(n, A) int64 fixed-point values of the attribute channels after `layer`, anchors in `order`."""
    last, classes = len(model.layers), content.classes[order]
    out = [np.zeros((len(order), 0), np.int64)]
    for index in model.attributes:
        steps, final = model.steps(layer, index, classes), model.steps(last, index, classes)
        now = coarsen(content.values[index][order], (final - steps)[:, None])
        out.append(fine(now, steps, best_engine()))
    return np.concatenate(out, axis=1)


def _latents(content: TileContent, order: I64, books: Codebooks, stages: I64, dimensions: int) -> I64:
    """(n, dimensions) int64 sums of the codewords received."""
    first = Codebooks(books.coarse[:, :dimensions], books.residual[:, :dimensions])
    return first.latents(content.indices[order].astype(np.int64), stages)
