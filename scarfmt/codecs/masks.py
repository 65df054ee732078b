"""Mask and offset sub-streams of the anchor profile (SPEC §7.4, §7.7; paper §3.7).

A mask bit is coded only for slots not yet on, so the incremental mask repeats nothing. Its context is how
many slots of the anchor are on already. A Gaussian's offset is sent once, in the layer that turns it on.
"""

from __future__ import annotations

import numpy as np

from scarfmt.arrays import Bools, Ints
from scarfmt.container.schema import Stream
from scarfmt.entropy.emitters import Emitter
from scarfmt.entropy.keys import TableKey
from scarfmt.entropy.symbol_reader import SymbolReader
from scarfmt.errors import Malformed
from scarfmt.scene.model import Channel

_MASK_KEY = TableKey(Stream.MASKS, 0, 0, 0)


def put_masks(emitter: Emitter, before: Bools, after: Bools) -> None:
    """Emit which slots turn on: (n, K) bool before and after this layer, after >= before."""
    on = before.sum(axis=1)
    for slot in range(before.shape[1]):
        chosen = np.flatnonzero(~before[:, slot])
        emitter.emit_by_context(_MASK_KEY, on[chosen], after[chosen, slot].astype(np.int64))
        on = on + (after[:, slot] & ~before[:, slot])


def get_masks(reader: SymbolReader, before: Bools) -> Bools:
    """Read the (n, K) bool mask after this layer.

    Raises:
        Malformed: ``bad-mask`` for a symbol that is not 0 or 1.
    """
    after = before.copy()
    on = before.sum(axis=1)
    for slot in range(before.shape[1]):
        chosen = np.flatnonzero(~before[:, slot])
        bits = reader.read_by_context(_MASK_KEY, on[chosen])
        if len(bits) and not (int(bits.min()) >= 0 and int(bits.max()) <= 1):
            raise Malformed("bad-mask", "a mask symbol is not 0 or 1 (SPEC §7.4)", field="masks")
        after[chosen, slot] = bits == 1
        on[chosen] += bits
    return after


def put_offsets(emitter: Emitter, channel: Channel, offsets: Ints, turned_on: Bools) -> None:
    """Emit the offsets of slots that turn on, anchor by anchor, slot by slot.

    Args:
        offsets: (n, K, 3) int32 quantised offsets.
        turned_on: (n, K) bool.
    """
    anchor, slot = np.nonzero(turned_on)
    context = np.zeros(len(anchor), np.int64)
    for component in range(channel.components):
        emitter.emit_by_context(TableKey(channel.stream, component, 1, 0), context, offsets[anchor, slot, component])


def get_offsets(reader: SymbolReader, channel: Channel, offsets: Ints, turned_on: Bools) -> None:
    """Read the offsets of slots that turn on into `offsets`, (n, K, 3) int32, in place."""
    anchor, slot = np.nonzero(turned_on)
    context = np.zeros(len(anchor), np.int64)
    for component in range(channel.components):
        values = reader.read_by_context(TableKey(channel.stream, component, 1, 0), context)
        offsets[anchor, slot, component] = values
