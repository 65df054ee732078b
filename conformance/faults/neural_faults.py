"""The invalid vectors of the neural entropy model (SPEC §10): one rule broken each, all checksums right."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from conformance.scenes.cases import Case, refused
from conformance.scenes.made import PLAIN, Plan, build, channel
from conformance.surgery.files import blocks_of, changed, rebuilt, tile_parts, vector_file, without
from conformance.writer.fields import varint
from conformance.writer.networks import network_block, predictors_block
from conformance.writer.tile import tile_block
from scarfmt.blocks.index_network import unpack_network
from scarfmt.blocks.predictors import unpack_predictors
from scarfmt.container.file import Block, Tile
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.neural.arithmetic import MAX_WEIGHT, Linear
from scarfmt.neural.network import IndexNetwork
from scarfmt.neural.predictors import Predictor
from scarfmt.scene.model import MAX_CLASSES, DecodedContext, LayerRow

Fault = tuple[str, str, str, str, bytes]
"""(name, what is wrong, rule, refusal id, file)."""
_OCCUPANCY_TARGETS = bytes([2, 2, 40, 5])
"""passes_log2, target_count and targets of the vector `predictors`."""


def neural_faults(files: dict[str, bytes]) -> Iterator[Case]:
    """Files that break a rule of §10, one each.

    Args:
        files: valid vectors by name.
    """
    for faults in (
        _layer_faults(files["predictors"], files["predictors-alone"]),
        _place_faults(files["index-grid"], files["index-flat"]),
        _header_faults(files["index-two-level"]),
        _bound_faults(files["index-edge"], files["index-equal"]),
        _predictor_faults(files["predictors"], files["predictors-edge"]),
        _grid_faults(files["index-grid-small"]),
    ):
        yield from (refused(*fault, stage="models") for fault in faults)
    seal = changed(files["index-flat"], BlockKind.TILE, 1, _word_before_indices)
    purpose = "INDICES in entropy mode 1 does not end in the empty state"
    yield refused("neural-seal", purpose, "R-8.2-2", "rans-seal", seal)


def _layer_faults(predictors: bytes, stageless: bytes) -> Iterator[Fault]:
    def context(new: bytes) -> bytes:
        def change(payload: bytes) -> bytes:
            assert payload.count(_OCCUPANCY_TARGETS) == 1
            return payload.replace(_OCCUPANCY_TARGETS, new)

        return changed(predictors, BlockKind.LAYER, 1, change)

    yield ("entropy-mode-2", "an entropy mode that is not assigned", "R-7.11-1", "unsupported-entropy-mode",
           changed(predictors, BlockKind.LAYER, 1, lambda payload: b"\2" + payload[1:]))
    yield "sixteen-passes", "passes_log2 is 4", "R-10.2-1", "bad-context", context(bytes([4, 2, 40, 5]))
    yield "targets-equal", "occupancy targets do not descend", "R-10.2-1", "bad-context", context(bytes([2, 2, 40, 40]))
    yield "target-zero", "an occupancy target is 0", "R-10.2-1", "bad-context", context(bytes([2, 2, 40, 0]))
    yield "target-large", "a target of 65536", "R-5.7-1", "bad-varint", context(bytes([2, 1, 0x80, 0x80, 4]))
    yield "five-targets", "five targets", "R-5.7-3", "count-limit", context(bytes([2, 5, 40, 30, 20, 10, 5]))
    yield ("mode-without-stage", "entropy mode 1 in a layer in which no class has a stage", "R-10.4-1",
           "bad-layer-table", changed(stageless, BlockKind.LAYER, 1, lambda payload: b"\1" + payload[1:]))


def _place_faults(grid: bytes, flat: bytes) -> Iterator[Fault]:
    kinds = BlockKind
    yield ("no-network", "entropy mode 1 without ENTROPY_NETWORK", "R-10.4-2", "missing-block",
           without(flat, kinds.ENTROPY_NETWORK, 1))
    yield ("idle-network", "a second ENTROPY_NETWORK, in the second layer of mode 1", "R-10.4-2", "unexpected-block",
           _copied(flat, kinds.ENTROPY_NETWORK))
    yield ("idle-grid", "a second HASH_GRID", "R-10.4-3", "unexpected-block", _copied(grid, kinds.HASH_GRID))
    yield ("no-grid", "the network has grid inputs, the file no HASH_GRID", "R-10.5-6", "bad-network",
           without(grid, kinds.HASH_GRID, 1))
    block = next(block for block in blocks_of(grid) if block.kind == kinds.HASH_GRID)
    yield ("grid-not-read", "the file has a HASH_GRID, the network no grid inputs", "R-10.5-6", "bad-network",
           rebuilt(flat, [*blocks_of(flat), block]))


def _copied(data: bytes, kind: BlockKind) -> bytes:
    blocks = blocks_of(data)
    return rebuilt(data, [*blocks, replace(next(block for block in blocks if block.kind == kind), layer=2)])


def _word_before_indices(payload: bytes) -> bytes:
    parts = tile_parts(payload)
    return tile_block({**parts, Stream.INDICES: bytes([1, 0, 0, 0]) + parts[Stream.INDICES]})


def _header_faults(deep: bytes) -> Iterator[Fault]:
    """Faults of a network of 12 bits, own inputs and attention, C 3, A 6, 2 depths, L 3, no grid, R 5, 2 recurrent
    layers."""

    def network(change: Callable[[bytearray], object]) -> bytes:
        def edit(content: bytes) -> bytes:
            out = bytearray(content)
            change(out)
            return bytes(out)

        return changed(deep, BlockKind.ENTROPY_NETWORK, 1, edit)

    yield "network-flag", "a flag that is not assigned", "R-10.5-1", "bad-network", network(lambda c: _put(c, 1, 7))
    yield ("network-wide-inputs", "more than 512 input columns", "R-10.5-1", "bad-network",
           network(lambda c: c.__setitem__(slice(8, 9), varint(500))))
    yield ("network-13-bits", "13 activation bits", "R-10.5-2", "bad-network", network(lambda c: _put(c, 0, 13)))
    yield ("network-codeword-shift", "a shift of 25", "R-10.5-2", "bad-network", network(lambda c: _put(c, 3, 25)))
    yield ("network-cut", "the network ends early", "R-5.7-2", "payload-short", network(lambda c: c.pop()))
    edited = _network_of(deep, 1)
    yield ("network-sixteen-classes", "columns for a sixteenth class", "R-10.5-2", "bad-network",
           _with_network(deep, _sixteen_classes(edited)))
    coarse, residual = edited.heads
    wrong = replace(residual, clusters=(*residual.clusters[:-1], residual.clusters[-1] + 1))
    yield ("clusters-too-large", "clusters that do not sum to the codewords", "R-10.5-5", "bad-network",
           _with_network(deep, replace(edited, heads=(coarse, wrong))))
    larger = replace(coarse, clusters=(*coarse.clusters, 1), cluster_biases=np.append(coarse.cluster_biases, 0),
                     biases=np.append(coarse.biases, 0))
    yield ("head-too-large", "a head for one codeword more than its codebook has", "R-10.5-6", "bad-network",
           _with_network(deep, replace(edited, heads=(larger, residual))))
    fewer = replace(edited.gru[0], biases=edited.gru[0].biases[:2])
    yield ("network-few-tokens", "no biases for the fourth of eight stages", "R-10.5-6", "bad-network",
           _with_network(deep, replace(edited, gru=(fewer, *edited.gru[1:]))))
    one_head = replace(edited, gru=(replace(edited.gru[0], inputs=edited.gru[0].inputs[:1]), *edited.gru[1:]),
                       heads=(coarse,))
    yield ("tokens-without-head", "biases for later stages, but one head", "R-10.5-4", "bad-network",
           _with_network(deep, one_head))
    # One attribute less, a latent and a class more: as wide, so that only A itself is wrong.
    inputs = replace(edited.inputs, attributes=5, latents=4, classes=edited.inputs.classes + 1)
    yield ("network-attributes", "as many input columns, but for five attribute components of six", "R-10.5-6",
           "bad-network", _with_network(deep, replace(edited, inputs=inputs)))
    start = edited.gru[0].start.copy()
    start[0] = edited.amax + 1
    yield ("start-too-large", "a start state beyond the activations", "R-10.5-2", "bad-network",
           _with_network(deep, replace(edited, gru=(replace(edited.gru[0], start=start), *edited.gru[1:]))))


def _sixteen_classes(network: IndexNetwork) -> IndexNetwork:
    """A network with columns of zeros for the classes after its own, up to class 15."""
    classes, (first, second) = network.inputs.classes, network.embed
    weights = np.insert(first.weights, [classes] * (MAX_CLASSES + 1 - classes), 0, axis=1)
    inputs = replace(network.inputs, classes=MAX_CLASSES + 1)
    return replace(network, inputs=inputs, embed=(replace(first, weights=weights), second))


def _put(content: bytearray, at: int, value: int) -> None:
    content[at] = value


def _network_of(data: bytes, layer: int) -> IndexNetwork:
    kind = BlockKind.ENTROPY_NETWORK
    return unpack_network(next(b.payload for b in blocks_of(data) if (b.kind, b.layer) == (kind, layer)))


def _with_network(data: bytes, network: IndexNetwork) -> bytes:
    return changed(data, BlockKind.ENTROPY_NETWORK, 1, lambda _: network_block(network))


def _bound_faults(edge: bytes, equal: bytes) -> Iterator[Fault]:
    """One bias of a network at the edge is one further from 0."""
    network = _network_of(edge, 1)
    mixer = replace(network.mixer, biases=_one_more(network.mixer.biases, -1))
    yield ("mixer-reach", "an accumulator that can reach 2^24", "R-10.1-1", "bad-network",
           _with_network(edge, replace(network, mixer=mixer)))
    first, second = network.gru
    recurrent = replace(first, recurrent_biases=_one_more(first.recurrent_biases, 3))
    yield ("recurrent-reach", "an accumulator of a recurrent layer that can reach 2^23", "R-10.5-3", "bad-network",
           _with_network(edge, replace(network, gru=(recurrent, second))))
    row = first.biases.copy()
    row[1] = _one_more(row[1], 5)
    token = replace(first, biases=row)
    yield ("token-reach", "the bias of a later stage reaches 2^23 with the worse matrix", "R-10.5-3", "bad-network",
           _with_network(edge, replace(network, gru=(token, second))))
    coarse, residual = network.heads
    logit = replace(coarse, biases=_one_more(coarse.biases, 7))
    yield ("logit-reach", "a logit's accumulator that can reach 2^24", "R-10.5-7", "bad-network",
           _with_network(edge, replace(network, heads=(logit, residual))))
    cluster = replace(residual, cluster_biases=_one_more(residual.cluster_biases, 1))
    yield ("cluster-reach", "a cluster logit's accumulator that can reach 2^24", "R-10.5-7", "bad-network",
           _with_network(edge, replace(network, heads=(coarse, cluster))))
    member = replace(residual, biases=_one_more(residual.biases, 4))
    yield ("member-reach", "a member logit's accumulator that can reach 2^24", "R-10.5-7", "bad-network",
           _with_network(edge, replace(network, heads=(coarse, member))))
    small = _network_of(equal, 1)
    lowest = small.mixer.weights.copy()
    lowest[0] = 0
    lowest[0, 0] = -32768
    layer = Linear(lowest, 0 * small.mixer.biases, 24)
    yield ("weight-lowest", "a weight of -32768 in a row that stays in reach", "R-10.1-1", "bad-network",
           _with_network(equal, replace(small, mixer=layer)))


def _one_more(biases: Any, at: int) -> Any:
    out = biases.copy()
    out[at] += 1 if out[at] > 0 else -1
    return out


def _predictor_faults(base: bytes, edge: bytes) -> Iterator[Fault]:
    def edited(change: Callable[[tuple[Predictor, ...]], tuple[Predictor, ...]], data: bytes = base) -> bytes:
        return changed(data, BlockKind.PREDICTORS, 1, lambda p: predictors_block(change(unpack_predictors(p))))

    def first(**fields: Any) -> Callable[[tuple[Predictor, ...]], tuple[Predictor, ...]]:
        return lambda predictors: (replace(predictors[0], **fields), *predictors[1:])

    yield ("predictors-none", "a PREDICTORS block without a predictor", "R-10.3-1", "bad-predictor",
           changed(base, BlockKind.PREDICTORS, 1, lambda _: b"\0"))
    yield ("predictor-residual", "a predictor of POSITION_RESIDUAL", "R-10.3-1", "bad-predictor",
           changed(base, BlockKind.PREDICTORS, 1, lambda c: c[:1] + bytes([Stream.POSITION_RESIDUAL]) + c[2:]))
    yield ("predictor-units", "65 hidden units", "R-10.3-1", "bad-predictor",
           changed(base, BlockKind.PREDICTORS, 1, lambda c: c[:8] + bytes([65]) + c[9:]))
    yield ("predictor-buckets", "257 buckets", "R-10.3-2", "bad-predictor", edited(first(buckets=(129, 2))))
    yield "predictor-step-zero", "a predictor of step 0", "R-10.3-2", "bad-predictor", edited(first(step=0))
    yield ("predictor-component", "a fourth scale", "R-10.3-3", "bad-predictor",
           edited(lambda ps: tuple(replace(p, component=3) if p.stream == Stream.SCALE and p.component == 2 else p
                                   for p in ps)))
    yield ("predictors-descend", "keys do not ascend", "R-10.3-3", "bad-predictor", edited(lambda ps: ps[::-1]))
    yield ("predictor-late", "a predictor in the layer after that in which its step first travels", "R-10.3-3",
           "bad-predictor", _moved(base))
    narrow = without(base, BlockKind.LAYER, 1)
    layer = next(block for block in blocks_of(base) if (block.kind, block.layer) == (BlockKind.LAYER, 1))
    fewer = replace(layer, payload=layer.payload.replace(_OCCUPANCY_TARGETS, bytes([2, 1, 40])))
    yield ("predictor-inputs", "as many inputs as two depths have; the file has one", "R-10.3-3", "bad-predictor",
           rebuilt(narrow, [*blocks_of(narrow), fewer]))

    yield ("predictor-inputs-wrapped", "346 inputs, of which a byte holds 90", "R-10.3-3", "bad-predictor",
           _wrapped_inputs())

    def reaching(predictors: tuple[Predictor, ...]) -> tuple[Predictor, ...]:
        output = predictors[0].output
        return first(output=replace(output, biases=_one_more(output.biases, 0)))(predictors)

    yield ("predictor-reach", "an accumulator that can reach 2^24", "R-10.1-1", "bad-predictor", edited(reaching, edge))

    for name, weight in (("", MAX_WEIGHT + 1), ("-low", -MAX_WEIGHT - 1)):
        yield (f"predictor-weight{name}", f"a weight of {weight} in a row that stays in reach", "R-10.1-1",
               "bad-predictor", edited(partial(_heavy, weight)))
    yield from _record_order_faults(base, edge)


def _wrapped_inputs() -> bytes:
    """A predictor of 90 inputs for LATENT of 64 components and four depths: 15 + 3 + 64 + 4 * 66 = 346."""
    channels = channel(Stream.SCALE, 0.5, PLAIN, PLAIN, PLAIN), channel(Stream.LATENT, 1.5, *(PLAIN,) * 64)
    data = vector_file(build(Plan(
        "wrapped inputs", channels, (LayerRow((0,), ((1, 1),)),), (Tile(0, 0, 0),), (10,), bits=5, dimension=64,
        context=DecodedContext(0, (8, 4, 2, 1)))))
    output = Linear(np.zeros((2, 346 % 256), np.int32), np.zeros(2, np.int64), 0)
    payload = predictors_block((Predictor(Stream.LATENT, 0, 1, None, output, (1, 1)),))
    return rebuilt(data, [*blocks_of(data), Block(BlockKind.PREDICTORS, 1, payload, count=1)])


def _heavy(weight: int, predictors: tuple[Predictor, ...]) -> tuple[Predictor, ...]:
    """The first predictor with this weight in its output layer, and no other."""
    output = predictors[0].output
    weights = 0 * output.weights
    weights[0, MAX_CLASSES] = weight
    return (replace(predictors[0], output=Linear(weights, 0 * output.biases, 8)), *predictors[1:])


def _record_order_faults(base: bytes, edge: bytes) -> Iterator[Fault]:
    """R-10.3-2 is applied after the bytes of the record, and before those of the next."""

    def cut_after(**fields: Any) -> Callable[[bytes], bytes]:
        return lambda p: predictors_block((replace(unpack_predictors(p)[0], **fields),))[:-1]

    for name, fields in (("step-zero", {"step": 0}), ("buckets", {"buckets": (129, 2)})):
        yield (f"predictor-{name}-cut", "a record that breaks R-10.3-2, and ends early", "R-5.7-2", "payload-short",
               changed(base, BlockKind.PREDICTORS, 1, cut_after(**fields)))

    def reaching(payload: bytes) -> bytes:
        one, *others = unpack_predictors(payload)
        output = replace(one.output, biases=_one_more(one.output.biases, 0))
        return predictors_block((replace(one, output=output), *others)) + b"\0"

    yield ("predictor-reach-long", "an accumulator that can reach 2^24, and a byte after the last record", "R-10.1-1",
           "bad-predictor", changed(edge, BlockKind.PREDICTORS, 1, reaching))


def _moved(data: bytes) -> bytes:
    """The file with the PREDICTORS block of layer 1 in layer 2, in place of its own."""
    blocks = blocks_of(without(data, BlockKind.PREDICTORS, 2))
    place = next(row for row, block in enumerate(blocks) if block.kind == BlockKind.PREDICTORS)
    blocks[place] = replace(blocks[place], layer=2)
    return rebuilt(data, blocks)


def _grid_faults(base: bytes) -> Iterator[Fault]:
    """Faults of a grid whose box, levels and level count take five bytes, then four or more a level."""

    def grid(change: Callable[[bytes], bytes]) -> bytes:
        return changed(base, BlockKind.HASH_GRID, 1, change)

    streams = _streams_at(base)
    yield ("grid-plane", "a plane that is not assigned", "R-10.6-1", "bad-grid",
           grid(lambda p: p[:5] + b"\7" + p[6:]))
    yield ("grid-flat-level", "a resolution of 0", "R-10.6-1", "bad-grid", grid(lambda p: p[:6] + b"\0" + p[7:]))
    yield ("grid-extent", "a box of 2^33 lattice steps", "R-10.6-1", "bad-grid",
           grid(lambda p: p[:3] + bytes([33]) + p[4:]))
    yield ("grid-certain", "bits that are never 1", "R-10.6-2", "bad-grid",
           grid(lambda p: p[:streams] + b"\0" + p[streams + 1 :]))
    yield ("grid-stream-odd", "a stream of the grid that is not whole words", "R-8.2-1", "rans-length",
           grid(lambda p: p[: streams + 1] + (1).to_bytes(4, "little") + p[streams + 5 :]))
    yield ("grid-seal", "a stream of the grid that does not end in the empty state", "R-8.2-2", "rans-seal",
           grid(lambda p: p[:streams] + bytes([p[streams] ^ 1]) + p[streams + 1 :]))


def _streams_at(base: bytes) -> int:
    """Offset of the first stream's probability in the HASH_GRID block."""
    payload = next(block.payload for block in blocks_of(base) if block.kind == BlockKind.HASH_GRID)
    at, numbers = 0, 5 + 4 * payload[4]
    while numbers:
        numbers -= payload[at] < 0x80
        at += 1
    return at
