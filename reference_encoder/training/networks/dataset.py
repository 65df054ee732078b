"""The rows that the index network is trained on: its inputs for every anchor and layer of a scene, and the indices.

A row is an anchor in a layer that gives it at least one RVQ stage (SPEC §10.5). Its inputs depend on the class, on the
anchor's own attributes and, through cell means, on anchors decoded earlier: those of layers before, and those of
earlier passes of the same tile-layer. They are equal to those of the decoder.

For the two-level head a codebook is ordered into contiguous clusters of like codewords. A cluster is found by halving:
codewords are sorted along the axis in which they spread most, and split where the numbers of clusters on both sides
want it. The zero codeword, by far the most frequent where a stage often adds nothing, is a cluster of its own, so that
coding it takes a single symbol.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.tuning import FEWEST_CLUSTERED
from scarfmt.arrays import F64, I16, I64
from scarfmt.codecs.channels import coarsen
from scarfmt.codecs.neural_indices import embedding_inputs
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import TileFrame, tile_frame
from scarfmt.neural.arithmetic import MAX_ACTIVATION_BITS, amplitude
from scarfmt.neural.layer_context import LayerContext, cell_centres
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import Codebooks, SceneModel

Clusters = tuple[I64, tuple[int, ...]]
"""A new order of n codewords: (n,) the old number of each, and the sizes of clusters; none: the book is coded flat."""


def cluster(words: I64, uses: I64) -> Clusters:
    """Clusters of similar size, about the square root of n of them.

    Args:
        words: (n, d) codewords.
        uses: (n,) how often each is used; within a cluster the most used come first.
    """
    if len(words) < FEWEST_CLUSTERED:
        return np.arange(len(words)), ()
    zero = np.flatnonzero(~words.any(axis=1))[:1]
    rest = np.setdiff1d(np.arange(len(words)), zero)
    groups = _split_members(words.astype(np.float64), rest, round(float(np.sqrt(len(rest)))))
    # Clusters of one size side by side are evaluated together.
    arranged = [group[np.argsort(-uses[group], kind="stable")] for group in sorted(groups, key=len)]
    arranged = [zero, *arranged] if len(zero) else arranged
    return np.concatenate(arranged), tuple(len(group) for group in arranged)


def _split_members(words: F64, members: I64, clusters: int) -> list[I64]:
    """`members` split into `clusters` groups, sizes as equal as can be."""
    if clusters <= 1:
        return [members]
    left = clusters // 2
    centred = words[members] - words[members].mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    axis = axes[:, -1]
    # An eigenvector has no sign of its own.
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    order = members[np.argsort(np.round(centred @ axis, 6), kind="stable")]
    cut = round(len(order) * left / clusters)
    return _split_members(words, order[:cut], left) + _split_members(words, order[cut:], clusters - left)


def arrange_scene(
    scene: QuantisedScene, rows: IndexRows
) -> tuple[QuantisedScene, IndexRows, tuple[tuple[int, ...], ...]]:
    """The scene and its rows with both books in the order of clusters, and the sizes of the clusters of each."""
    old = scene.codebooks
    assert old is not None
    coarse, residual = code_uses(rows, old.sizes)
    clusters = cluster(old.coarse, coarse), cluster(old.residual, residual)
    orders, sizes = [order for order, _ in clusters], tuple(size for _, size in clusters)
    rows = replace(rows, codes=_renumber(rows.codes, orders))
    contents = tuple(_recode(scene.model, content, orders) for content in scene.contents)
    books = Codebooks(old.coarse[orders[0]], old.residual[orders[1]])
    return replace(scene, contents=contents, codebooks=books), rows, sizes


def _renumber(codes: I16, orders: Sequence[I64]) -> I16:
    """(n, M) indices by the new numbers: the coarse book's, then the residual book's."""
    ranks = [np.argsort(order).astype(np.int16) for order in orders]
    return np.stack([ranks[min(stage, 1)][codes[:, stage]] for stage in range(codes.shape[1])], axis=1)


def _recode(model: SceneModel, content: TileContent, orders: Sequence[I64]) -> TileContent:
    received = model.stages(len(model.layers), content.classes)
    indices = _renumber(content.indices, orders) * (np.arange(model.max_stages) < received[:, None])
    return replace(content, indices=indices.astype(np.int16))


_WIDEST = amplitude(MAX_ACTIVATION_BITS)
"""Inputs are clamped to what the widest activations hold."""


@dataclass(frozen=True)
class IndexRows:
    """Rows of training samples.

    Attributes:
        inputs: (n, width) int16, not yet clamped to the network's own activations.
        before, after: (n,) int64 stages received before and after the row's layer; before < after.
        codes: (n, M) int16 codeword numbers of all stages.
        positions: (n, 3) int64 lattice coordinates of the centres of the anchors' cells, for a hash grid (SPEC §10.6).
        symbols: indices coded in the whole scene.
    """

    inputs: I16
    before: I64
    after: I64
    codes: I16
    positions: I64
    symbols: int

    def __len__(self) -> int:
        return len(self.before)


def code_uses(rows: IndexRows, sizes: Sequence[int]) -> list[I64]:
    """(n,) uses of each codeword of the coarse and the residual book in `rows`."""
    uses = [np.zeros(size, np.int64) for size in sizes]
    for stage in range(1, rows.codes.shape[1] + 1):
        sent = (rows.before < stage) & (rows.after >= stage)
        book = min(stage - 1, 1)
        uses[book] += np.bincount(rows.codes[sent, stage - 1], minlength=sizes[book])
    return uses


def index_rows(scene: QuantisedScene, own: bool, latents: int, most: int | None = None, seed: int = 0) -> IndexRows:
    """Samples of a scene: all rows, or about `most` of them chosen by `seed`.

    Args:
        scene: with codebooks; its context says which cell means are inputs.
        own: whether an anchor's own attributes are inputs.
        latents: latent dimensions whose cell means are inputs.
    """
    model, layers = scene.model, range(1, len(scene.model.layers) + 1)
    classes = np.concatenate([content.classes for content in scene.contents])
    total = sum(int((model.stages(k, classes) > model.stages(k - 1, classes)).sum()) for k in layers)
    share = 1.0 if most is None or most >= total else most / max(total, 1)
    draw = np.random.default_rng(seed)
    inputs, none = describe_inputs(model, own, latents, 0), np.zeros(0, np.int64)
    no_codes = np.zeros((0, model.max_stages), np.int16)
    parts = [(np.zeros((0, inputs.width), np.int16), none, none, no_codes, np.zeros((0, 3), np.int64))]
    for tile, content in zip(scene.tiles, scene.contents, strict=True):
        frame = tile_frame(scene.fields, tile)
        for layer in layers:
            parts += _layer_rows(scene, content, frame, layer, inputs, share, draw)
    rows, before, after, codes, positions = (np.concatenate(column) for column in zip(*parts, strict=True))
    return IndexRows(rows, before, after, codes, positions, int(model.stages(len(layers), classes).sum()))


def _layer_rows(
    scene: QuantisedScene,
    content: TileContent,
    frame: TileFrame,
    layer: int,
    inputs: Inputs,
    share: float,
    draw: np.random.Generator,
) -> Iterator[tuple[I16, I64, I64, I16, I64]]:
    """The rows of a layer of a tile, the first five attributes of `IndexRows`; nothing where it has none."""
    model, books = scene.model, scene.codebooks
    assert books is not None
    content = content.head(int((content.classes < model.layers[layer - 1].class_count).sum()))
    classes = content.classes
    before, after = model.stages(layer - 1, classes), model.stages(layer, classes)
    if not (before < after).any():
        return
    context = LayerContext(model, frame, content.codes, classes)
    for index in model.attributes:
        steps, final = model.steps(layer, index, classes), model.steps(len(model.layers), index, classes)
        context.settle(index, coarsen(content.values[index], (final - steps)[:, None]), steps)
    columns = np.zeros((len(classes), inputs.width), np.int16)
    for part, x in embedding_inputs(inputs, _WIDEST, books, None, context, content.indices, (before, after)):
        columns[part] = x
    group = context.by_code[(before < after)[context.by_code]]
    wanted = group[draw.random(len(group)) < share] if share < 1 else group
    positions = cell_centres(frame, content.codes[wanted])
    yield columns[wanted], before[wanted], after[wanted], content.indices[wanted], positions


def describe_inputs(model: SceneModel, own: bool, latents: int, grid_features: int) -> Inputs:
    """Meaning of the columns of the inputs; `own` and `latents` as of :func:`index_rows`."""
    attributes = sum(model.channels[index].components for index in model.attributes)
    depths, classes = len(model.context.occupancies), model.layers[-1].class_count
    return Inputs(classes, own, attributes, depths, latents, 0, grid_features)
