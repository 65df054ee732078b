"""Whatever the bytes: a scene, or a ScarError."""

from __future__ import annotations

import contextlib
import gzip

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.errors import ScarError
from scarfmt.formats import load
from tests.formats.scene_files import EXAMPLES, anchor_arrays, npy, sog_files, spz, zipped

FORMAT_OF = {name: name.split()[0] for name in EXAMPLES}
ODD_BYTES = st.one_of(
    st.sampled_from([b"", b"\x00", b"\xff" * 4, b"\x00\x00\x00\x80", b" 9", b"-1 ", b"\n", b"nan", b'"']),
    st.binary(max_size=6),
)


MEMBERS = {"sog": sog_files(), "anchor-npz": {f"{name}.npy": npy(array) for name, array in anchor_arrays().items()}}


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """A valid file cut, or with a few short stretches replaced, removed or repeated."""
    if draw(st.integers(0, 5)) == 0:
        return data[: draw(st.integers(0, len(data)))]
    for _ in range(draw(st.integers(1, 3))):
        # Headers decide most: half of the damage falls into the first hundred bytes.
        start = draw(st.one_of(st.integers(0, min(100, len(data))), st.integers(0, len(data))))
        length = draw(st.integers(0, 8))
        insert = draw(st.one_of(ODD_BYTES, st.just(data[start : start + length] * 2)))
        data = data[:start] + insert + data[start + length :]
    return data


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.filterwarnings("ignore::UserWarning")
@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_damage_gives_a_scene_or_a_deliberate_error(name: str, data: st.DataObject) -> None:
    content = data.draw(damaged(EXAMPLES[name]))
    with contextlib.suppress(ScarError):
        load(content, format=FORMAT_OF[name])
    with contextlib.suppress(ScarError):
        load(content)


@pytest.mark.parametrize("name", MEMBERS)
@pytest.mark.filterwarnings("ignore::UserWarning")
@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_damage_inside_an_archive_whose_checksums_hold(name: str, data: st.DataObject) -> None:
    member = data.draw(st.sampled_from(sorted(MEMBERS[name])))
    content = zipped(MEMBERS[name] | {member: data.draw(damaged(MEMBERS[name][member]))})
    with contextlib.suppress(ScarError):
        load(content, format=name)


@pytest.mark.parametrize("version", [1, 2, 3])
@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_damage_inside_a_gzip_stream_whose_checksum_holds(version: int, data: st.DataObject) -> None:
    content = data.draw(damaged(gzip.decompress(spz(version))))
    with contextlib.suppress(ScarError):
        load(gzip.compress(content), format="spz")


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_flipped_bit_of_the_first_bytes(name: str) -> None:
    content = EXAMPLES[name]
    for position in range(min(64, len(content))):
        for bit in (0, 3, 7):
            changed = bytearray(content)
            changed[position] ^= 1 << bit
            with contextlib.suppress(ScarError):
                load(bytes(changed), format=FORMAT_OF[name])
