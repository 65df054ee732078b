"""Index sub-stream in entropy mode 1: every codeword number by the index network (SPEC §10.5; paper §3.4).

Anchors travel pass by pass: those of a pass are embedded with what earlier passes revealed around them, then
coded stage by stage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, I16, I32, I64, Ints
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.neural.context import count_features
from scarfmt.neural.evaluator import Evaluator
from scarfmt.neural.grid import HashGrid
from scarfmt.neural.layer_context import LayerContext, cell_centres
from scarfmt.neural.network import Inputs
from scarfmt.scene.model import Codebooks

CLASS_VALUE = 64
_ATTRIBUTE_SHIFT = 6


# (stage, anchors, mixer outputs) -> nothing: emits or reads one run of symbols.
Exchange = Callable[[int, I64, F32], None]


def embedding_inputs(
    inputs: Inputs,
    amax: int,
    books: Codebooks,
    grid: HashGrid | None,
    context: LayerContext,
    indices: Ints,
    stages: tuple[I64, I64],
) -> Iterator[tuple[I64, F32]]:
    """The anchors that get indices in a tile-layer, pass by pass, each with the input columns of SPEC §10.5.

    The indices of a pass must be in `indices` before the next is asked for.

    Args:
        inputs: which columns there are; they are clamped to `amax`.
        books: the codebooks, of which latents are the sums.
        grid: the hash grid, if columns are its features.
        context: with every channel settled for this layer.
        indices: (n, stages) int16 codeword numbers.
        stages: two (n,), before and after this layer.

    Yields:
        (m,) anchors, and (m, width) float32 integers.
    """
    before, after = stages
    settled, width = context.list_settled(), inputs.latents
    means = context.sums(settled.shape[1] + width)
    known, cohort = np.flatnonzero(before > 0), np.flatnonzero(before < after)
    means.add(context.rows(known), _seen(settled, books, indices, known, before, width))
    features = _grid_features(grid, context, before < after)
    for part in context.parts(cohort):
        x = np.zeros((len(part), inputs.width), np.float32)
        kinds = context.classes[part]
        some = np.flatnonzero(kinds < inputs.classes)
        x[some, kinds[some]] = CLASS_VALUE
        at = inputs.classes
        if inputs.own:
            x[:, at : at + inputs.attributes] = settled[part] >> _ATTRIBUTE_SHIFT
            at += inputs.attributes
        around, counts = means.around(context.rows(part))
        for depth in range(inputs.depths):
            mean, latents = np.split(around[:, depth], [inputs.attributes], axis=1)
            x[:, at : at + inputs.attributes] = np.floor(mean * 2.0**-_ATTRIBUTE_SHIFT)
            at += inputs.attributes
            x[:, at : at + width] = np.floor(latents * 2.0**-inputs.latent_shift + 0.5 * (inputs.latent_shift > 0))
            x[:, at + width] = count_features(counts[:, depth])
            at += width + 1
        x[:, at:] = features[part]
        yield part, np.clip(x, -amax, amax, out=x)
        # An anchor refined in this layer now counts twice: as it was before the layer and as it is after it.
        means.add(context.rows(part), _seen(settled, books, indices, part, after, width))


def _seen(settled: I32, books: Codebooks, indices: Ints, rows: I64, stages: I64, width: int) -> I64:
    """(m, A + width) what others see of the anchors `rows` at (n,) `stages`: attributes and first latents."""
    return np.concatenate([settled[rows], books.latents(indices[rows], stages[rows], width)], axis=1)


def _grid_features(grid: HashGrid | None, context: LayerContext, wanted: NDArray[np.bool_]) -> I16:
    """(n, features) int16 of the hash grid at the anchors `wanted`, (n,) bool; 0 at others."""
    out = np.zeros((len(context), 0 if grid is None else grid.width), np.int16)
    if grid is not None and wanted.any():
        # In Morton order, in which neighbours share cells.
        ordered = context.by_code[wanted[context.by_code]]
        out[ordered] = grid.features(cell_centres(context.frame, context.codes[ordered]))
    return out


def put_neural_indices(
    emitter: Emitter,
    evaluator: Evaluator,
    context: LayerContext,
    indices: Ints,
    before: I64,
    after: I64,
) -> None:
    """Emit stages before+1..after of every anchor known.

    Args:
        context: with every channel settled for this layer.
        indices: (n, stages) int16 codeword numbers.
        before, after: (n,) stages before and after this layer.
    """

    def put(stage: int, anchors: I64, mixed: F32) -> None:
        codes, at = indices[anchors, stage - 1].astype(np.int64), 0
        for weights in evaluator.frequency_blocks(int(stage > 1), mixed):
            emitter.emit_rows(weights, codes[at : at + len(weights)])
            at += len(weights)

    _code(evaluator, context, indices, (before, after), put)


def get_neural_indices(
    reader: SymbolReader,
    evaluator: Evaluator,
    context: LayerContext,
    indices: I16,
    before: I64,
    after: I64,
) -> None:
    """Read stages before+1..after into `indices`, (n, stages) int16, in place.

    Args:
        context, before, after: as of :func:`put_neural_indices`.
    """

    def get(stage: int, anchors: I64, mixed: F32) -> None:
        blocks = evaluator.frequency_blocks(int(stage > 1), mixed)
        indices[anchors, stage - 1] = np.concatenate([reader.read_rows(weights, stage) for weights in blocks])

    _code(evaluator, context, indices, (before, after), get)


def _code(
    evaluator: Evaluator,
    context: LayerContext,
    indices: Ints,
    stages: tuple[I64, I64],
    exchange: Exchange,
) -> None:
    before, after = stages
    network, books, grid = evaluator.network, evaluator.books, evaluator.grid
    for part, inputs in embedding_inputs(network.inputs, network.amax, books, grid, context, indices, stages):
        _code_pass(evaluator, context, part, inputs, indices, (before[part], after[part]), exchange)


def _code_pass(
    evaluator: Evaluator,
    context: LayerContext,
    part: I64,
    inputs: F32,
    indices: Ints,
    stages: tuple[I64, I64],
    exchange: Exchange,
) -> None:
    """All stages of the anchors of one pass; the recurrent state runs over stages received earlier, too."""
    before, after = stages
    embedded = evaluator.embed(inputs)
    if context.observer is not None:
        context.observer.embedding(embedded)
    state = evaluator.start(len(part))
    for stage in range(1, int(after.max(initial=0)) + 1):
        coded = np.flatnonzero((before < stage) & (after >= stage))
        if len(coded):
            whole = len(coded) == len(part)
            here = (embedded, state) if whole else (embedded[coded], evaluator.take(state, coded))
            exchange(stage, part[coded], evaluator.mix(*here))
        if stage < int(after.max()):
            # Anchors without this stage are not coded later: their state no longer matters.
            state = evaluator.advance(state, stage, np.where(after >= stage, indices[part, stage - 1], 0))
