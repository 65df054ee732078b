"""The block of the index network: everything comes back, and no payload does anything but refuse."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from neural.networks import Case, cases, random_books, random_network

from scarfmt.bytefields import compress, decompress
from scarfmt.codecs.network import MAX_NETWORK_BYTES, pack_network, unpack_network
from scarfmt.errors import LimitExceeded, Malformed, ScarError
from scarfmt.neural.network import IndexNetwork, Inputs

INPUTS = Inputs(classes=1, own=True, attributes=2, depths=1, latents=1, latent_shift=1, grid=0)


def same(a: Any, b: Any) -> bool:
    """Equal in every field, arrays in type and shape too."""
    if is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and bool((a == b).all())
    return type(a) is type(b) and bool(a == b)


def small(**options: Any) -> IndexNetwork:
    rng = np.random.default_rng(4)
    return random_network(rng, random_books(rng, 5, 4, 2), INPUTS, hidden=3, **options)


@settings(deadline=None, max_examples=100)
@given(cases())
def test_networks_come_back(case: Case) -> None:
    """Of every kind, with weights of one byte and of two, and biases of any size."""
    assert same(unpack_network(pack_network(case.network)), case.network)


@pytest.mark.parametrize("extreme", [127, -127, 128, -128, 32767, -32767])
def test_the_extremes_of_both_widths_come_back(extreme: int) -> None:
    """A weight that does not fit a byte makes its matrix wide."""
    network = small()
    weights = np.zeros_like(network.mixer.weights)
    weights[0, 1] = extreme
    changed = replace(network, mixer=replace(network.mixer, weights=weights, biases=network.mixer.biases * 0, shift=0))
    assert same(unpack_network(pack_network(changed)), changed)


def content(network: IndexNetwork) -> bytes:
    return decompress(pack_network(network), MAX_NETWORK_BYTES, "network")


@pytest.mark.parametrize("two_level", [False, True])
def test_every_prefix_is_refused(two_level: bool) -> None:
    """Of the content, and of the frame."""
    network = small(two_level=two_level)
    whole, frame = content(network), pack_network(network)
    for end in range(len(whole)):
        with pytest.raises(Malformed) as caught:
            unpack_network(compress(whole[:end]))
        assert caught.value.refusal in ("payload-short", "bad-zstd")
    for end in range(len(frame)):
        with pytest.raises(ScarError):
            unpack_network(frame[:end])
    with pytest.raises(Malformed) as caught:
        unpack_network(compress(whole + b"\0"))
    assert caught.value.refusal == "payload-long"


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_damaged_payloads_are_networks_or_are_refused(data: st.DataObject) -> None:
    """Any bytes changed: a refusal, or a network that passes its check and packs again."""
    damaged = bytearray(content(small()))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.one_of(st.integers(0, 20), st.integers(0, len(damaged) - 1)))
        damaged[at] = data.draw(st.integers(0, 255))
    try:
        found = unpack_network(compress(bytes(damaged)))
    except ScarError:
        return
    found.check_structure()
    assert same(unpack_network(pack_network(found)), found)


# Offsets of the header: bits, flags, two shifts, five columns, four widths, three counts, then the first layer.
@pytest.mark.parametrize(
    ("offset", "value", "error", "refusal"),
    [
        (0, 7, Malformed, "bad-network"),
        (0, 13, Malformed, "bad-network"),
        (1, 4, Malformed, "bad-network"),
        (2, 25, Malformed, "bad-network"),
        (3, 25, Malformed, "bad-network"),
        (9, 65, LimitExceeded, "count-limit"),
        (13, 5, LimitExceeded, "count-limit"),
        (14, 8, LimitExceeded, "count-limit"),
        (15, 3, LimitExceeded, "count-limit"),
        (16, 25, Malformed, "bad-network"),
        (17, 0, Malformed, "bad-network"),
        (17, 3, Malformed, "bad-network"),
    ],
)
def test_header_fields_out_of_range_are_refused(offset: int, value: int, error: type, refusal: str) -> None:
    """One byte changed each."""
    changed = bytearray(content(small()))
    changed[offset] = value
    with pytest.raises(error) as caught:
        unpack_network(compress(bytes(changed)))
    assert caught.value.refusal == refusal


def test_a_broken_bound_is_refused() -> None:
    """What check finds, reading finds too."""
    network = small()
    heavy = replace(network.mixer, biases=network.mixer.biases + (1 << 24))
    with pytest.raises(Malformed) as caught:
        unpack_network(pack_network(replace(network, mixer=heavy)))
    assert caught.value.refusal == "bad-network"


def test_more_columns_than_allowed_are_refused_before_they_are_read() -> None:
    """511 attributes at 511 depths are each within their limit."""
    with pytest.raises(Malformed) as caught:
        unpack_network(compress(bytes([10, 0, 0, 0, 0, 0xFF, 3, 0xFF, 3, 0, 0, 1, 1, 1, 1, 1, 0, 1])))
    assert caught.value.refusal == "bad-network"


def test_the_content_limit_holds() -> None:
    """Before anything is decompressed."""
    with pytest.raises(LimitExceeded) as caught:
        unpack_network(pack_network(small()), limit=100)
    assert caught.value.refusal == "content-limit"
