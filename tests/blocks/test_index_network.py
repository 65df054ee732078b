"""The block of the index network: everything comes back, and no payload does anything but refuse."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.blocks.index_network import pack_network, unpack_network
from scarfmt.errors import LimitExceeded, Malformed, ScarError
from scarfmt.neural.network import IndexNetwork, Inputs
from scarfmt.scene.model import MAX_CLASSES
from tests.neural.networks import Case, cases, random_books, random_network
from tests.samples.codec_samples import refuses

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
    """Networks of every kind come back, with weights and biases of any size."""
    assert same(unpack_network(pack_network(case.network)), case.network)


def with_weight(weight: int) -> IndexNetwork:
    """A network whose mixer has one weight, no bias and no shift."""
    network = small()
    weights = np.zeros_like(network.mixer.weights)
    weights[0, 1] = weight
    return replace(network, mixer=replace(network.mixer, weights=weights, biases=network.mixer.biases * 0, shift=0))


@pytest.mark.parametrize("extreme", [32767, -32767])
def test_the_largest_weights_come_back(extreme: int) -> None:
    """Among zeros."""
    changed = with_weight(extreme)
    assert same(unpack_network(pack_network(changed)), changed)


@pytest.mark.parametrize("weight", [32768, -32768, 65536, 2**31 - 1, -(2**31)])
def test_weights_beyond_32767_are_refused(weight: int) -> None:
    """A weight beyond 32767 is refused, even one whose magnitude no int32 holds."""
    refuses("bad-network", lambda: unpack_network(pack_network(with_weight(weight))))


@pytest.mark.parametrize("two_level", [False, True])
def test_every_prefix_is_refused(two_level: bool) -> None:
    """No byte is spare."""
    whole = pack_network(small(two_level=two_level))
    for end in range(len(whole)):
        refuses("payload-short", partial(unpack_network, whole[:end]))
    refuses("payload-long", lambda: unpack_network(whole + b"\0"))


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_damaged_payloads_are_networks_or_are_refused(data: st.DataObject) -> None:
    """Any bytes changed: a refusal, or a network that passes its check and packs again."""
    damaged = bytearray(pack_network(small()))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.one_of(st.integers(0, 20), st.integers(0, len(damaged) - 1)))
        damaged[at] = data.draw(st.integers(0, 255))
    try:
        found = unpack_network(bytes(damaged))
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
        (17, 32, Malformed, "bad-rice"),
    ],
)
def test_header_fields_out_of_range_are_refused(offset: int, value: int, error: type[ScarError], refusal: str) -> None:
    """One byte changed each."""
    changed = bytearray(pack_network(small()))
    changed[offset] = value
    with pytest.raises(error) as caught:
        unpack_network(bytes(changed))
    assert caught.value.refusal == refusal


def test_a_broken_bound_is_refused() -> None:
    """A bound that writing checks is also checked by reading."""
    network = small()
    heavy = replace(network.mixer, biases=network.mixer.biases + (1 << 24))
    refuses("bad-network", lambda: unpack_network(pack_network(replace(network, mixer=heavy))))


def test_columns_for_fifteen_classes_at_most() -> None:
    """Fifteen classes are as many as a scene can have."""
    rng = np.random.default_rng(4)
    books = random_books(rng, 5, 4, 2)
    most = random_network(rng, books, replace(INPUTS, classes=MAX_CLASSES), hidden=3)
    assert same(unpack_network(pack_network(most)), most)
    first, second = most.embed
    wider = replace(first, weights=np.pad(first.weights, ((0, 0), (0, 1))))
    more = replace(most, inputs=replace(most.inputs, classes=MAX_CLASSES + 1), embed=(wider, second))
    refuses("bad-network", lambda: unpack_network(pack_network(more)))


def test_more_columns_than_allowed_are_refused_before_they_are_read() -> None:
    """511 attributes at 511 depths are each within their limit."""
    header = bytes([10, 0, 0, 0, 0, 0xFF, 3, 0xFF, 3, 0, 0, 1, 1, 1, 1, 1, 0, 1])
    refuses("bad-network", lambda: unpack_network(header))


def test_reserved_flags_are_judged_with_the_number_of_columns() -> None:
    """R-10.5-1: after the counts, before the first layer."""
    changed = bytearray(pack_network(small()))
    changed[1], changed[13] = 4, 5
    with pytest.raises(LimitExceeded):
        unpack_network(bytes(changed))
    changed[13] = 1
    refuses("bad-network", lambda: unpack_network(bytes(changed[:16])))
