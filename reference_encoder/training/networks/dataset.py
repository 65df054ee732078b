"""The rows that the index network is trained on: its inputs for every anchor and layer of a scene, and the indices.

A row is an anchor in a layer that gives it at least one RVQ stage (SPEC §10.5). Its inputs depend on the class, on the
anchor's own attributes and, through cell means, on anchors decoded earlier: those of layers before, and those of
earlier passes of the same tile-layer. They are equal to those of the decoder.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import I16, I64
from scarfmt.codecs.channels import coarsen
from scarfmt.codecs.neural_indices import embedding_inputs
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.directory import TileFrame, tile_frame
from scarfmt.neural.arithmetic import MAX_ACTIVATION_BITS, amplitude
from scarfmt.neural.layer_context import LayerContext, cell_centres
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import SceneModel

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
