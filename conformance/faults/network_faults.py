"""Invalid vectors of ENTROPY_NETWORK, HASH_GRID and PREDICTORS blocks (SPEC §10.3-§10.6): limits, ends, widths."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from conformance.surgery.files import blocks_of, changed, rebuilt
from conformance.writer.fields import rice, shifted, varint
from conformance.writer.networks import network_block, predictors_block
from scarfmt.blocks.index_network import unpack_network
from scarfmt.blocks.predictors import unpack_predictors
from scarfmt.container.bytefields import ByteReader
from scarfmt.container.schema import BlockKind, Stream
from scarfmt.neural.arithmetic import Linear
from scarfmt.neural.network import GruLayer, Head, IndexNetwork
from scarfmt.neural.predictors import Predictor

Fault = tuple[str, str, str, str, bytes]
"""(name, what is wrong, rule, refusal id, file)."""
_RANGE, _ROWS, _HEADS, _FIT = (
    (rule, "bad-network") for rule in ("R-10.5-2", "R-10.1-1", "R-10.5-5", "R-10.5-6")
)
_LIMIT = "R-5.7-3", "count-limit"
_SHORT, _LONG = ("R-5.7-2", "payload-short"), ("R-5.7-2", "payload-long")
_UNEXPECTED = "unexpected-block"
_NETWORK, _GRID, _PREDICTORS = BlockKind.ENTROPY_NETWORK, BlockKind.HASH_GRID, BlockKind.PREDICTORS


def network_of(data: bytes) -> IndexNetwork:
    """The index network of a file."""
    return unpack_network(next(block.payload for block in blocks_of(data) if block.kind == _NETWORK))


def _with_network(data: bytes, network: IndexNetwork) -> bytes:
    return changed(data, _NETWORK, 1, lambda _: network_block(network))


def network_faults(deep: bytes, flat: bytes, equal: bytes, predictors: bytes) -> Iterator[Fault]:
    """Faults of networks with attention and two-level heads, with flat heads, as wide as the latent; and of
    predictors."""
    yield from _width_faults(flat)
    yield from _shift_faults(deep, flat)
    yield from _reach_faults(deep)
    yield from _wide_faults(deep, predictors)
    yield from _head_faults(deep)
    yield from _fit_faults(deep, flat, equal)
    yield from _limit_faults(flat)


def _rows(layer: Linear, count: int) -> Linear:
    return Linear(layer.weights[:count], layer.biases[:count], layer.shift)


def _columns(layer: Linear, count: int) -> Linear:
    return Linear(layer.weights[:, :count], layer.biases, layer.shift)


def _width_faults(flat: bytes) -> Iterator[Fault]:
    """Widths of 0, arrays to match."""
    network = network_of(flat)
    first, second = network.embed
    gru, = network.gru
    inputs = replace(network.inputs, classes=0, own=False)
    yield ("network-no-input", "no input columns", *_RANGE,
           _with_network(flat, replace(network, inputs=inputs, embed=(_columns(first, 0), second))))
    yield ("network-no-codeword-dims", "no codeword dimensions", *_RANGE,
           _with_network(flat, replace(network, codeword_dims=0, gru=(_narrow(gru, 1),), heads=tuple(
               replace(head, projections=(_rows(head.projections[0], 1),)) for head in network.heads))))
    yield ("network-no-embedding", "an embedding of no width", *_RANGE,
           _with_network(flat, replace(network, embed=(_rows(first, 0), _columns(second, 0)))))
    none = np.zeros((0, 0), np.int32)
    still = GruLayer(tuple(matrix[:0] for matrix in gru.inputs), none, gru.biases[:, :0], gru.recurrent_biases[:0],
                     gru.start[:0], gru.shift)
    yield ("network-no-state", "a state of no width", *_RANGE,
           _with_network(flat, replace(network, embed=(first, _rows(second, 0)), gru=(still,),
                                       mixer=_columns(network.mixer, 0))))
    silent = tuple(replace(head, projections=(_columns(head.projections[0], 0),)) for head in network.heads)
    yield ("network-no-mixer", "a mixer of no width", *_RANGE,
           _with_network(flat, replace(network, mixer=_rows(network.mixer, 0), heads=silent)))
    yield ("network-no-head", "no head", *_RANGE,
           _with_network(flat, replace(network, gru=(replace(gru, inputs=(), biases=gru.biases[:0]),), heads=())))
    yield "network-no-recurrence", "no recurrent layer", *_RANGE, _without_recurrence(flat)
    rested = tuple(replace(layer, start=0 * layer.start) for layer in network.gru)
    yield ("network-7-bits-alone", "7 activation bits, start states of 0", *_RANGE,
           _with_network(flat, replace(network, activation_bits=7, gru=rested)))
    alone = 0 * network.mixer.weights
    alone[0, 0] = -32768
    yield ("weight-low-alone", "a weight of -32768 among zeros", "R-10.5-1", "bad-network",
           _with_network(flat, replace(network, mixer=Linear(alone, 0 * network.mixer.biases, 0))))
    yield ("network-7-bits", "7 activation bits", *_RANGE, changed(flat, _NETWORK, 1, lambda p: bytes([7]) + p[1:]))


def _narrow(gru: GruLayer, columns: int) -> GruLayer:
    return replace(gru, inputs=tuple(matrix[:, :columns] for matrix in gru.inputs))


def _without_recurrence(flat: bytes) -> bytes:
    """The file whose network has no recurrent layer, nor tokens."""
    network = network_of(flat)
    first, second = network.embed
    inputs, dims, heads = network.inputs, network.codeword_dims, network.heads
    columns = (inputs.classes, inputs.attributes, inputs.depths, inputs.latents, inputs.grid)
    widths = (dims, first.outputs, second.outputs, network.mixer.outputs, 0, 0, len(heads))
    parts = [bytes([network.activation_bits, inputs.own, inputs.latent_shift, network.codeword_shift])]
    parts += [varint(n) for n in (*columns, *widths)]
    parts += [_packed(layer) for layer in (first, second, network.mixer)]
    for head in heads:
        parts += [varint(len(head.biases)), b"\0", _packed(head.projections[0])]
        parts += [bytes([head.shift, 0]), shifted(head.cluster_biases.tolist()), shifted(head.biases.tolist())]
    return changed(flat, _NETWORK, 1, lambda _: b"".join(parts))


def _packed(layer: Linear) -> bytes:
    return bytes([layer.shift]) + rice(layer.weights.ravel().tolist()) + shifted(layer.biases.tolist())


def _shift_faults(deep: bytes, flat: bytes) -> Iterator[Fault]:
    """A shift of 25 each."""
    network = network_of(deep)
    attention, (coarse, residual), (low, high) = network.attention, network.heads, network.gru
    assert attention is not None

    def edited(**fields: Any) -> bytes:
        return _with_network(deep, replace(network, **fields))

    steep = {
        "latent": edited(inputs=replace(network.inputs, latent_shift=25)),
        "recurrent": edited(gru=(low, replace(high, shift=25))),
        "score": edited(attention=replace(attention, shift=25)),
        "logit": edited(heads=(replace(coarse, shift=25), residual)),
        "member": edited(heads=(coarse, replace(residual, member_shift=25))),
    }
    for name, data in steep.items():
        yield f"network-{name}-shift", f"the {name} shift is 25", *_RANGE, data
    yield ("network-linear-shift", "the shift of a linear layer is 25", *_ROWS,
           edited(mixer=replace(network.mixer, shift=25)))
    flat_network = network_of(flat)
    head, other = flat_network.heads
    yield ("head-flat-member-shift", "a flat head with a member shift", *_HEADS,
           _with_network(flat, replace(flat_network, heads=(replace(head, member_shift=1), other))))


def _reach_faults(deep: bytes) -> Iterator[Fault]:
    """Linear layers with a bias of 2^24 or -2^24."""
    network = network_of(deep)
    attention, (coarse, residual) = network.attention, network.heads
    (first, second), (one, two) = network.embed, coarse.projections
    assert attention is not None
    loud: dict[str, dict[str, Any]] = {
        "embed1": {"embed": (_loud(first, 1), second)},
        "embed2": {"embed": (first, _loud(second, -1))},
        "query": {"attention": replace(attention, query=_loud(attention.query, 1))},
        "key": {"attention": replace(attention, key=_loud(attention.key, -1))},
        "value": {"attention": replace(attention, value=_loud(attention.value, 1))},
        "project1": {"heads": (replace(coarse, projections=(_loud(one, 1), two)), residual)},
        "project2": {"heads": (replace(coarse, projections=(one, _loud(two, -1))), residual)},
    }
    for name, fields in loud.items():
        yield f"{name}-reach", f"a bias of {name} reaches 2^24", *_ROWS, _with_network(deep, replace(network, **fields))
    top = replace(network.gru[1], biases=network.gru[1].biases + (1 << 23))
    yield ("recurrent-upper-reach", "a bias of the second recurrent layer reaches 2^23", "R-10.5-3", "bad-network",
           _with_network(deep, replace(network, gru=(network.gru[0], top))))


def _wide_faults(deep: bytes, predictors: bytes) -> Iterator[Fault]:
    """Numbers near the ends of 32 bits, where a check in too narrow a type fails to see them."""
    network = network_of(deep)
    for name, what, value in (("lowest", "-2^31", -(1 << 31)), ("wraps", "2^16 + 1", (1 << 16) + 1)):
        weights: Any = network.mixer.weights.astype(np.int64)
        weights[0, 0] = value
        mixer = Linear(weights, network.mixer.biases, network.mixer.shift)
        yield (f"mixer-weight-{name}", f"a weight of {what}", "R-10.5-1", "bad-network",
               _with_network(deep, replace(network, mixer=mixer)))
    biases = network.mixer.biases.copy()
    for name, value in (("highest", (1 << 31) - 1), ("lowest", 1 - (1 << 31))):
        biases[0] = value
        yield (f"mixer-bias-{name}", f"a bias of {value}", *_ROWS,
               _with_network(deep, replace(network, mixer=replace(network.mixer, biases=biases.copy()))))

    def edit(payload: bytes) -> bytes:
        first, *others = unpack_predictors(payload)
        weights: Any = first.output.weights.astype(np.int64)
        weights[1, -1] = -(1 << 31)
        output = Linear(weights, first.output.biases, first.output.shift)
        return predictors_block((replace(first, output=output), *others))

    yield ("predictor-weight-lowest", "a weight of -2^31", "R-10.3-2", "bad-predictor",
           changed(predictors, _PREDICTORS, 1, edit))


def _loud(layer: Linear, sign: int) -> Linear:
    biases = layer.biases.copy()
    biases[-1] = sign << 24
    return replace(layer, biases=biases)


def _head_faults(deep: bytes) -> Iterator[Fault]:
    network = network_of(deep)
    coarse, residual = network.heads

    def headed(first: Head, second: Head = residual) -> bytes:
        return _with_network(deep, replace(network, heads=(first, second)))

    start = network.gru[0].start.copy()
    start[0] = -network.amax - 1
    yield ("start-too-low", "a start state below the activations", *_RANGE,
           _with_network(deep, replace(network, gru=(replace(network.gru[0], start=start), network.gru[1]))))
    yield ("cluster-empty", "a cluster of no codewords", *_HEADS,
           headed(replace(coarse, clusters=(0, *coarse.clusters[1:-1], coarse.clusters[0] + coarse.clusters[-1]))))
    yield ("clusters-too-small", "clusters of a codeword less than the head has", *_HEADS,
           headed(replace(coarse, clusters=(*coarse.clusters[:1], coarse.clusters[1] - 1, *coarse.clusters[2:]))))
    none = replace(coarse, biases=coarse.biases[:0], clusters=(), cluster_biases=coarse.cluster_biases[:0],
                   projections=coarse.projections[:1], member_shift=0)
    yield "head-empty", "a flat head for no codewords", *_HEADS, headed(none)


def _fit_faults(deep: bytes, flat: bytes, equal: bytes) -> Iterator[Fault]:
    network, shallow, small = network_of(deep), network_of(flat), network_of(equal)
    coarse, residual = network.heads
    fewer = replace(coarse, clusters=(*coarse.clusters[:1], coarse.clusters[1] - 1, *coarse.clusters[2:]),
                    biases=coarse.biases[:-1])
    yield ("head-too-small", "a head for a codeword less than its codebook has", *_FIT,
           _with_network(deep, replace(network, heads=(fewer, residual))))
    bare = replace(shallow.gru[0], inputs=shallow.gru[0].inputs[:1], biases=shallow.gru[0].biases[:0])
    yield ("head-missing", "codebook 1, but one head and no tokens", *_FIT,
           _with_network(flat, replace(shallow, gru=(bare,), heads=shallow.heads[:1])))
    # Without depths the columns stay as many.
    yield ("network-latents", "more latent means than the latent has dimensions", *_FIT,
           _with_network(flat, replace(shallow, inputs=replace(shallow.inputs, latents=5))))
    wide = replace(
        small, codeword_dims=3,
        gru=(replace(small.gru[0], inputs=tuple(np.pad(m, ((0, 0), (0, 1))) for m in small.gru[0].inputs)),),
        heads=tuple(replace(head, projections=tuple(map(_row_more, head.projections))) for head in small.heads),
    )
    yield ("network-codeword-dims", "more codeword dimensions than the latent has", *_FIT, _with_network(equal, wide))
    inputs = replace(small.inputs, depths=2)
    weights = np.pad(small.embed[0].weights, ((0, 0), (0, inputs.width - small.inputs.width)))
    embed = (replace(small.embed[0], weights=weights), small.embed[1])
    yield ("network-depths", "columns for two depths, the file has one", *_FIT,
           _with_network(equal, replace(small, inputs=inputs, embed=embed)))


def _row_more(layer: Linear) -> Linear:
    return Linear(np.pad(layer.weights, ((0, 1), (0, 0))), np.append(layer.biases, 0), layer.shift)


def _limit_faults(flat: bytes) -> Iterator[Fault]:
    """Counts above their limits; each is refused before anything that follows it is looked at."""
    # Two class columns and six own values are the others.
    yield ("network-513-inputs", "513 input columns", "R-10.5-1", "bad-network",
           changed(flat, _NETWORK, 1, partial(_with_count, place=4, value=505)))
    names = ("classes", "attributes", "depths", "latents", "grid", "codeword_dims", "embed_width", "hidden", "mixed",
             "gru_count", "tokens", "head_count")
    limits = (512,) * 5 + (64, 256, 256, 256, 4, 7, 2)
    for place, (name, limit) in enumerate(zip(names, limits, strict=True)):
        yield (f"network-many-{name.replace('_', '-')}", f"{name} is {limit + 1}", *_LIMIT,
               changed(flat, _NETWORK, 1, partial(_with_count, place=place, value=limit + 1)))
    yield "network-long", "a byte after the last head", *_LONG, changed(flat, _NETWORK, 1, lambda p: p + b"\0")
    network = network_of(flat)
    before = network_block(network)[: -_head_bytes(network)]
    for name, what, new in (
        ("head-4097", "a head for 4097 codewords", varint(4097)),
        ("clusters-257", "257 clusters", varint(12) + varint(257)),
        ("cluster-4097", "a cluster of 4097 codewords", bytes([12, 1]) + varint(4097)),
    ):
        yield name, what, *_LIMIT, changed(flat, _NETWORK, 1, _always(before + new))


def _always(payload: bytes) -> Callable[[bytes], bytes]:
    return lambda _: payload


def _with_count(payload: bytes, place: int, value: int) -> bytes:
    """A network with another of its twelve counts."""
    reader = ByteReader(payload[4:], "network")
    counts = [reader.unsigned(63) for _ in range(12)]
    counts[place] = value
    return payload[:4] + b"".join(map(varint, counts)) + reader.rest(len(payload))


def _head_bytes(network: IndexNetwork) -> int:
    """How many bytes the last head takes."""
    shorter = replace(network, heads=network.heads[:1])
    return len(network_block(network)) - len(network_block(shorter))


# ---------------------------------------------------------------------------------------------- HASH_GRID


Numbers = Callable[[list[int]], None]
"""Changes the numbers of a grid: origin, extent, level count; plane, resolution, table_log2, features of each level."""


def _with_grid(small: bytes, numbers: Numbers, rest: Callable[[bytes], bytes] = bytes, growth: int = 0) -> bytes:
    """The file with other numbers of its grid, and other streams after them."""
    return changed(small, _GRID, 1, lambda p: _with_numbers(p, numbers, rest), growth)


def _put(place: int, value: int) -> Numbers:
    return lambda numbers: numbers.__setitem__(place, value)


def grid_faults(small: bytes, static: bytes, modes: bytes) -> Iterator[Fault]:
    """Faults of a grid of few levels, of a file without a network, and of one whose first layer has entropy mode 0."""
    rule = "R-10.6-1", "bad-grid"
    levels = len(_numbers(small)) // 4 - 1
    yield ("grid-no-level", "a grid of no levels", *rule, _no_level(small, -levels))
    for name, what, place, value in (
        ("resolution", "a resolution of 65536", 6, 65536), ("table-0", "a table_log2 of 0", 7, 0),
        ("table-20", "a table_log2 of 20", 7, 20), ("no-feature", "a level without features", 8, 0),
        ("features-9", "a level of nine features", 8, 9),
    ):
        yield f"grid-{name}", what, *rule, _with_grid(small, _put(place, value))
    yield ("grid-bits", "tables of more than 2^24 bits together", *rule,
           _with_grid(small, _large_tables, growth=5 - levels))
    yield "grid-origin", "an origin of 2^32", "R-5.7-1", "bad-varint", _with_grid(small, _put(0, 1 << 32))
    yield "grid-levels-17", "17 levels", *_LIMIT, _with_grid(small, _put(4, 17), growth=17 - levels)
    yield from _grid_stream_faults(small)
    yield from _place_faults(small, static, modes)


def _grid_stream_faults(small: bytes) -> Iterator[Fault]:
    def streams(rest: Callable[[bytes], bytes]) -> bytes:
        return _with_grid(small, _put(0, _numbers(small)[0]), rest)

    yield "grid-short", "a grid that ends in its last stream", *_SHORT, streams(lambda rest: rest[:-1])
    yield "grid-long", "a byte after the last stream", *_LONG, streams(lambda rest: rest + b"\0")
    yield ("grid-stream-long", "a stream of 2^32 - 1 bytes", *_SHORT,
           streams(lambda rest: rest[:1] + b"\xff\xff\xff\xff" + rest[5:]))
    yield ("grid-last-word", "a stream of the grid whose last word is 0", "R-8.2-1", "rans-last-word",
           streams(lambda rest: rest[:1] + bytes([4, 0, 0, 0]) + bytes(4) + _after_stream(rest)))
    yield "grid-word-more", "a word more than the bits of a level take", "R-8.2-2", "rans-seal", streams(_word_more)


def _place_faults(small: bytes, static: bytes, modes: bytes) -> Iterator[Fault]:
    block = next(block for block in blocks_of(small) if block.kind == _GRID)
    yield ("grid-without-mode", "HASH_GRID in a file without entropy mode 1", "R-10.4-3", _UNEXPECTED,
           rebuilt(static, [*blocks_of(static), block]))
    yield ("grid-early", "HASH_GRID in a layer before the first of entropy mode 1", "R-10.4-3", _UNEXPECTED,
           rebuilt(modes, [*blocks_of(modes), block]))
    network = next(block for block in blocks_of(modes) if block.kind == _NETWORK)
    yield ("network-without-mode", "ENTROPY_NETWORK in a file without entropy mode 1", "R-10.4-2", _UNEXPECTED,
           rebuilt(static, [*blocks_of(static), replace(network, layer=1)]))
    blocks = [block for block in blocks_of(modes) if block.kind != _NETWORK]
    yield ("network-early", "ENTROPY_NETWORK in layer 1, the first of entropy mode 1 is layer 2", "R-10.4-2",
           _UNEXPECTED, rebuilt(modes, [*blocks, replace(network, layer=1)]))
    # Without other flags: no own inputs, no attention.
    yield ("network-flag-only", "the flag 4, and no other", "R-10.5-1", "bad-network",
           changed(small, _NETWORK, 1, lambda p: p[:1] + b"\4" + p[2:]))


def _numbers(data: bytes) -> list[int]:
    payload = next(block.payload for block in blocks_of(data) if block.kind == _GRID)
    reader = ByteReader(payload, "grid")
    numbers = [reader.unsigned(63) for _ in range(5)]
    return numbers + [reader.unsigned(63) for _ in range(4 * numbers[4])]


def _with_numbers(payload: bytes, change: Numbers, rest: Callable[[bytes], bytes]) -> bytes:
    reader = ByteReader(payload, "grid")
    numbers = [reader.unsigned(63) for _ in range(5)]
    numbers += [reader.unsigned(63) for _ in range(4 * numbers[4])]
    change(numbers)
    return b"".join(map(varint, numbers)) + rest(reader.rest(len(payload)))


def _no_level(small: bytes, growth: int) -> bytes:
    box = _numbers(small)[:4]
    return changed(small, _GRID, 1, lambda _: b"".join(map(varint, (*box, 0))), growth)


def _large_tables(numbers: list[int]) -> None:
    """Hashed tables of 2^19 entries of 8 bits: four of them have 2^24 bits, and there is one more level."""
    for place in range(5, len(numbers), 4):
        numbers[place : place + 4] = [0, 65535, 19, 8]
    while numbers[4] < 5:
        numbers += [0, 65535, 19, 8]
        numbers[4] += 1


def _after_stream(rest: bytes) -> bytes:
    return rest[5 + int.from_bytes(rest[1:5], "little") :]


def _word_more(rest: bytes) -> bytes:
    length = int.from_bytes(rest[1:5], "little")
    return rest[:1] + (length + 4).to_bytes(4, "little") + bytes([1, 0, 0, 0]) + rest[5:]


# ---------------------------------------------------------------------------------------------- PREDICTORS


def predictor_faults(base: bytes, edge: bytes, alone: bytes) -> Iterator[Fault]:
    """Faults of the vectors `predictors`, `predictors-edge` and `predictors-alone`, which has no ROTATION."""
    head, fit = ("R-10.3-1", "bad-predictor"), ("R-10.3-3", "bad-predictor")

    def byte(place: int, value: int) -> bytes:
        """Change a byte of the first record: stream 1, component 2, step 3, b1 4, b2 5, classes 6, inputs 7, units
        8."""
        return changed(base, _PREDICTORS, 1, lambda p: p[:place] + bytes([value]) + p[place + 1 :])

    def edited(change: Callable[[tuple[Predictor, ...]], tuple[Predictor, ...]], data: bytes = base) -> bytes:
        before = unpack_predictors(next(block.payload for block in blocks_of(data) if block.kind == _PREDICTORS))
        after = change(before)
        return changed(data, _PREDICTORS, 1, lambda _: predictors_block(after), len(after) - len(before))

    yield "predictor-indices", "a predictor of INDICES", *head, byte(1, int(Stream.INDICES))
    yield "predictor-classes", "columns of sixteen classes", *head, byte(6, 16)
    yield "predictor-no-inputs", "fifteen inputs", *head, byte(7, 15)
    yield "predictor-shift", "a shift of 25", "R-10.1-1", "bad-predictor", edited(lambda ps: (_steep(ps[0]), *ps[1:]))
    yield ("predictor-hidden-reach", "an accumulator of a hidden unit that can reach 2^24", "R-10.1-1", "bad-predictor",
           edited(lambda ps: (_loud_hidden(ps[0]), *ps[1:]), edge))
    yield "predictors-equal", "two predictors of one key", *fit, edited(lambda ps: (ps[0], *ps))
    yield ("predictor-no-channel", "a predictor of a channel that the file does not have", *fit,
           edited(lambda ps: (*ps[:2], replace(ps[2], stream=Stream.ROTATION), *ps[3:]), alone))
    yield ("predictor-no-step", "a predictor of a step that never travels", *fit,
           edited(lambda ps: (*ps[:-1], replace(ps[-1], step=20))))
    yield ("predictor-early", "a predictor of a step that first travels in the next layer", *fit,
           edited(lambda ps: (*ps[:-1], replace(ps[-1], step=2))))
    yield ("predictor-wide", "an input more than there is to see", *fit,
           edited(lambda ps: (_wider(ps[0]), *ps[1:])))
    yield ("predictors-1025", "1025 predictors", *_LIMIT,
           changed(base, _PREDICTORS, 1, lambda p: varint(1025) + p[1:]))
    yield "predictors-short", "a predictor that ends early", *_SHORT, changed(base, _PREDICTORS, 1, lambda p: p[:-1])
    yield ("predictors-long", "a byte after the last predictor", *_LONG,
           changed(base, _PREDICTORS, 1, lambda p: p + b"\0"))


def _steep(predictor: Predictor) -> Predictor:
    return replace(predictor, output=replace(predictor.output, shift=25))


def _loud_hidden(predictor: Predictor) -> Predictor:
    assert predictor.hidden is not None
    biases = predictor.hidden.biases.copy()
    biases[0] += 1 if biases[0] > 0 else -1
    return replace(predictor, hidden=replace(predictor.hidden, biases=biases))


def _wider(predictor: Predictor) -> Predictor:
    """The predictor with an input of weight 0 more, after its other inputs."""
    hidden, at = predictor.hidden, predictor.inputs
    if hidden is not None:
        hidden = replace(hidden, weights=np.insert(hidden.weights, at, 0, axis=1))
    return replace(predictor, hidden=hidden,
                   output=replace(predictor.output, weights=np.insert(predictor.output.weights, at, 0, axis=1)))
