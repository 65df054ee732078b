"""Index sub-stream: the RVQ codeword of every stage (SPEC §7.6; paper §3.2).

Stage 1 indexes the coarse codebook, later stages the shared residual codebook. Static tables are kept per
stage, class and whether the stage before chose codeword 0, the cheapest: who needed no refinement once
seldom needs the next.
"""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import I64, Ints
from scarfmt.container.schema import Stream
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.errors import Malformed


def _contexts(indices: Ints, classes: I64, stage: int) -> I64:
    return classes * 16 + (indices[:, stage - 2] == 0 if stage > 1 else 0)


def put_indices(emitter: Emitter, indices: Ints, classes: I64, before: I64, after: I64) -> None:
    """Emit stages before+1..after of every anchor of a tile.

    Args:
        indices: (n, stages) int16 codeword numbers.
        classes, before, after: (n,) class and stages before and after this layer.
    """
    for stage in range(1, int(after.max(initial=0)) + 1):
        chosen = np.flatnonzero((before < stage) & (after >= stage))
        part = indices[chosen]
        key = TableKey(Stream.INDICES, stage, 0, 0)
        emitter.emit_by_context(key, _contexts(part, classes[chosen], stage), part[:, stage - 1])


def get_indices(
    reader: SymbolReader, indices: Ints, classes: I64, before: I64, after: I64, book_sizes: tuple[int, int]
) -> None:
    """Read stages before+1..after into `indices`, (n, stages) int16, in place.

    Args:
        book_sizes: codewords in the coarse and the residual codebook.

    Raises:
        Malformed: ``bad-index`` for a number without a codeword.
    """
    for stage in range(1, int(after.max(initial=0)) + 1):
        chosen = np.flatnonzero((before < stage) & (after >= stage))
        if not len(chosen):
            continue
        key = TableKey(Stream.INDICES, stage, 0, 0)
        values = reader.read_by_context(key, _contexts(indices[chosen], classes[chosen], stage))
        size = book_sizes[stage > 1]
        if not (int(values.min()) >= 0 and int(values.max()) < size):
            raise Malformed("bad-index", f"stage {stage}: an index is not below {size} (SPEC §7.6)", field="indices")
        indices[chosen, stage - 1] = values
