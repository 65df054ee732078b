"""Networks: exact weights through the block, every shape rule, and the value they compute."""

from __future__ import annotations

import itertools
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.mlp import MAX_LAYERS, MAX_NETWORKS, MAX_WIDTH, Linear, QuantisedMlp, pack_networks, unpack_networks
from scarfmt.container.bytefields import compress, unsigned_varint
from scarfmt.errors import LimitExceeded, ScarError
from tests.samples.codec_samples import refuses


def network(seed: int, widths: list[int], bits: int = 8) -> QuantisedMlp:
    rng = np.random.default_rng(seed)
    return QuantisedMlp(
        tuple(
            Linear.quantised(rng.normal(size=(rows, columns)), rng.normal(size=rows), bits)
            for columns, rows in itertools.pairwise(widths)
        )
    )


def same(found: tuple[QuantisedMlp, ...], wanted: tuple[QuantisedMlp, ...]) -> bool:
    pairs = list(zip(found, wanted, strict=True))
    return all(
        np.array_equal(getattr(a, name), getattr(b, name)) and getattr(a, name).dtype == getattr(b, name).dtype
        for one, two in pairs
        for a, b in zip(one.layers, two.layers, strict=True)
        for name in ("weights", "scales", "biases")
    )


@settings(deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.lists(st.integers(1, 9), min_size=2, max_size=1 + MAX_LAYERS), max_size=MAX_NETWORKS),
    st.sampled_from([2, 8, 9, 16]),
)
def test_networks_come_back(seed: int, shapes: list[list[int]], bits: int) -> None:
    """Chains of any widths, 8-bit and 16-bit weights."""
    networks = tuple(network(seed, widths, bits) for widths in shapes)
    found = unpack_networks(pack_networks(networks))
    assert same(found, networks)
    assert [(n.inputs, n.outputs) for n in found] == [(widths[0], widths[-1]) for widths in shapes]


@pytest.mark.parametrize("extreme", [127, -127, 128, -128, 32767, -32767, -32768])
def test_the_extremes_of_both_widths_come_back(extreme: int) -> None:
    """A weight that does not fit a byte makes its layer wide, -32768 too."""
    weights = np.array([[1, extreme], [0, 0]], np.int16)
    layer = Linear(weights, np.array([0.5, 0], np.float32), np.array([0, -3], np.float32))
    assert same(unpack_networks(pack_networks((QuantisedMlp((layer,)),))), (QuantisedMlp((layer,)),))


def block(*layers: bytes, networks: int = 1, count: int | None = None) -> bytes:
    counts = unsigned_varint(networks) + unsigned_varint(len(layers) if count is None else count)
    return compress(counts + b"".join(layers))


def layer(rows: int, columns: int, width: int = 1, scale: float = 1.0, bias: float = 0.0) -> bytes:
    head = unsigned_varint(rows) + unsigned_varint(columns) + bytes([width])
    return head + bytes(rows * columns * width) + struct.pack(f"<{2 * rows}f", *[scale] * rows, *[bias] * rows)


def test_the_hand_made_network_is_readable() -> None:
    """The refusals below are for what was crafted."""
    (found,) = unpack_networks(block(layer(3, 2), layer(1, 3, 2)))
    assert [part.weights.shape for part in found.layers] == [(3, 2), (1, 3)]


BAD = {
    "no layer": (block(), "bad-mlp"),
    "no rows": (block(layer(0, 2)), "bad-mlp"),
    "no columns": (block(layer(2, 0)), "bad-mlp"),
    "width 0": (block(layer(1, 1, 0)), "bad-mlp"),
    "width 3": (block(layer(1, 1, 3)), "bad-mlp"),
    "layers that do not chain": (block(layer(3, 2), layer(1, 2)), "bad-mlp"),
    "infinite scale": (block(layer(1, 1, scale=float("inf"))), "bad-mlp"),
    "NaN scale": (block(layer(1, 1, scale=float("nan"))), "bad-mlp"),
    "infinite bias": (block(layer(1, 1, bias=float("-inf"))), "bad-mlp"),
    "short": (block(layer(2, 2)[:-1]), "payload-short"),
    "missing layer": (block(layer(2, 2), count=2), "payload-short"),
    "missing network": (block(layer(2, 2), networks=2), "payload-short"),
    "long": (block(layer(2, 2) + b"\0"), "payload-long"),
    "not zstd": (layer(2, 2), "bad-zstd"),
}


@pytest.mark.parametrize("name", BAD)
def test_blocks_that_break_the_rule_are_refused(name: str) -> None:
    """Each rule of SPEC §7.9 by one block."""
    data, refusal = BAD[name]
    refuses(refusal, lambda: unpack_networks(data))


@pytest.mark.parametrize(
    "cut",
    [b"\1\0", b"\1\1\0", b"\1\1\2\0", b"\1\1\2\3\5", b"\1\1\1\1\1\7" + struct.pack("<f", np.inf)],
    ids=["layers", "rows", "columns", "width", "scale"],
)
def test_each_number_is_checked_before_the_next_is_read(cut: bytes) -> None:
    """A wrong number that the content ends with is what is refused, not the end (SPEC R-7.9-1)."""
    refuses("bad-mlp", lambda: unpack_networks(compress(cut)))


@pytest.mark.parametrize(
    "data",
    [
        block(layer(1, 1), networks=MAX_NETWORKS + 1),
        block(*[layer(1, 1)] * (MAX_LAYERS + 1)),
        compress(b"\1\1" + unsigned_varint(MAX_WIDTH + 1) + b"\1\1"),
        compress(b"\1\1\1" + unsigned_varint(MAX_WIDTH + 1) + b"\1"),
    ],
)
def test_numbers_above_the_maxima_pass_a_limit(data: bytes) -> None:
    """Refused before anything is read or allocated."""
    with pytest.raises(LimitExceeded):
        unpack_networks(data)


def test_the_caller_bounds_the_content() -> None:
    """A block within the format's maxima but above the caller's limit."""
    data = pack_networks((network(1, [64, 64]),))
    with pytest.raises(LimitExceeded) as caught:
        unpack_networks(data, 1000)
    assert caught.value.refusal == "content-limit"


@settings(max_examples=200)
@given(st.binary(min_size=1, max_size=60))
def test_garbage_raises_only_our_errors(content: bytes) -> None:
    """Any bytes, also as content of a valid frame, give finite weights or a refusal."""
    for data in (content, compress(content)):
        try:
            networks = unpack_networks(data)
        except ScarError:
            continue
        assert all(np.isfinite(part.scales).all() for net in networks for part in net.layers)


@pytest.mark.parametrize("bits", [8, 16])
def test_quantised_weights_are_within_half_a_step(bits: int) -> None:
    """Each row on its own scale; rows of zeros stay zero."""
    rng = np.random.default_rng(2)
    weights = rng.normal(size=(5, 7)) * np.array([1e-3, 1, 1e3, 0, 1e-12])[:, None]
    found = Linear.quantised(weights, np.zeros(5), bits)
    assert bool((np.abs(found.matrix - weights) <= 0.5001 * found.scales[:, None]).all())
    top = np.abs(weights).max(axis=1)
    assert np.allclose(found.scales, np.maximum(top, 1e-30) / ((1 << bits - 1) - 1), rtol=1e-6)


def test_networks_compute_relu_between_layers_and_none_after() -> None:
    """In binary32 near the binary64 reference (SPEC §9.5)."""
    net = network(3, [6, 20, 10, 4])
    x = np.random.default_rng(4).normal(size=(50, 6))
    y = x
    for index, part in enumerate(net.layers):
        y = (np.maximum(y, 0) if index else y) @ part.matrix.T + part.biases
    assert np.allclose(net.apply(x, np.float64), y, rtol=1e-12)
    assert net.apply(x).dtype == np.float32
    assert np.allclose(net.apply(x), y, rtol=1e-4, atol=1e-4)
    assert float(y.min()) < 0
