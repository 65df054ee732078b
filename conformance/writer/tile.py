"""The symbols of one layer of one tile, in the order of SPEC §7.1."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field

from conformance.decoders.python.fields import CLASSES, INDICES, MASKS, OFFSETS, POSITIONS, key
from conformance.writer.anchors import Anchors
from conformance.writer.contexts import step_symbols, table_contexts
from conformance.writer.neural import Models, Seen, put_neural_indices, put_predicted_step
from conformance.writer.positions import put_positions
from conformance.writer.substream import Substream
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Profile, Stream

MAX_STEPS, MAX_STAGES = 20, 8


@dataclass(frozen=True)
class TileLayer:
    """One layer of one tile: how many anchors appear, and the symbols by stream kind."""

    new: int
    streams: dict[int, Substream] = field(default_factory=dict)


def tile_block(streams: Mapping[int, bytes] | Mapping[Stream, bytes]) -> bytes:
    """A TILE block; a sub-stream of no bytes gets no record."""
    present = {kind: data for kind, data in sorted(streams.items()) if data}
    records = [struct.pack("<BII", kind, len(data), zlib.crc32(data)) for kind, data in present.items()]
    table = bytes([len(records)]) + b"".join(records)
    return table + struct.pack("<I", zlib.crc32(table)) + b"".join(present.values())


def tile_layer(scene: QuantisedScene, layer: int, number: int, models: Models) -> TileLayer:
    """The content of a tile in a layer."""
    anchors = Anchors(scene, number, layer)
    tile = scene.tiles[number]
    bits = scene.fields.lattice_bits - tile.depth - tile.shift
    seen = Seen(anchors, bits)
    out = TileLayer(anchors.new)
    if anchors.new:
        out.streams[POSITIONS], out.streams[CLASSES] = Substream(), Substream()
        put_positions(out.streams[POSITIONS], anchors.codes[-anchors.new :], bits)
        _put_classes(out.streams[CLASSES], anchors)
    if scene.fields.profile == Profile.ANCHOR:
        out.streams[MASKS] = _masks(anchors)
    for i, channel in enumerate(scene.model.channels):
        stream = Substream()
        if channel.stream == Stream.OFFSETS:
            _put_offsets(stream, anchors, i)
        else:
            _put_channel(stream, seen, i, models)
        out.streams[int(channel.stream)] = stream
    out.streams[INDICES] = Substream()
    if scene.model.layers[layer - 1].neural:
        put_neural_indices(out.streams[INDICES], seen, models, scene.fields.lattice_bits)
    else:
        _put_indices(out.streams[INDICES], anchors)
    return out


def _put_classes(out: Substream, anchors: Anchors) -> None:
    first, past = anchors.class_count(anchors.layer - 1), anchors.class_count(anchors.layer)
    if past - first > 1:
        out.put(key(CLASSES, 0, 0, 0), [c - first for c in anchors.classes[-anchors.new :]])


def _masks(anchors: Anchors) -> Substream:
    out, layer = Substream(), anchors.layer
    on = [sum(0 < at < layer for at in slots) for slots in anchors.slot_layers]
    for s in range(anchors.model.slots):
        chosen = [a for a, slots in enumerate(anchors.slot_layers) if not 0 < slots[s] < layer]
        turned = [int(anchors.slot_layers[a][s] == layer) for a in chosen]
        out.put_by_context(key(MASKS, 0, 0, 0), [on[a] for a in chosen], turned)
        for a, bit in zip(chosen, turned, strict=True):
            on[a] += bit
    return out


def _put_offsets(out: Substream, anchors: Anchors, i: int) -> None:
    pairs = [
        (a, s) for a, slots in enumerate(anchors.slot_layers) for s, at in enumerate(slots) if at == anchors.layer
    ]
    for j in range(3):
        out.put_by_context(key(OFFSETS, j, 1, 0), [0] * len(pairs), [anchors.offset(i, a, s)[j] for a, s in pairs])


def _put_channel(out: Substream, seen: Seen, i: int, models: Models) -> None:
    anchors = seen.anchors
    channel, layer = anchors.model.channels[i], anchors.layer
    before, after = anchors.steps(layer - 1, i), anchors.steps(layer, i)
    for n in range(1, MAX_STEPS + 1):
        chosen = [a for a in range(len(before)) if before[a] < n <= after[a]]
        if not chosen:
            continue
        if any((channel.stream, j, n) in models.predictors for j in range(channel.components)):
            put_predicted_step(out, seen, (i, n), chosen, models)
            continue
        for j in range(channel.components):
            contexts = table_contexts(anchors, (i, j, n), chosen)
            out.put_by_context(key(channel.stream, j, n, 0), contexts, step_symbols(anchors, (i, j, n), chosen))


def _put_indices(out: Substream, anchors: Anchors) -> None:
    """INDICES in entropy mode 0."""
    before, after = anchors.stages(anchors.layer - 1), anchors.stages(anchors.layer)
    for stage in range(1, MAX_STAGES + 1):
        chosen = [a for a in range(len(before)) if before[a] < stage <= after[a]]
        index = anchors.index
        contexts = [16 * anchors.classes[a] + (stage > 1 and index[a][stage - 1] == 0) for a in chosen]
        out.put_by_context(key(INDICES, stage, 0, 0), contexts, [index[a][stage] for a in chosen])
