"""The header of a Zstandard frame (RFC 8878, section 3.1.1.1), read here because SPEC §5.8 orders its checks.

The zstandard package refuses some headers, those of huge windows, before it tells what they say.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from scarfmt.errors import Malformed

_MAGIC = 0xFD2FB528
_SINGLE_SEGMENT, _RESERVED, _CHECKSUM = 1 << 5, 1 << 3, 1 << 2
_DICTIONARY_BYTES = (0, 1, 2, 4)
_SIZE_BYTES = (0, 2, 4, 8)
_BLOCK_KINDS = ("raw", "repeated", "compressed", "reserved")


class FrameHeader(NamedTuple):
    """The header of a frame.

    Attributes:
        content_size: bytes of its content; 0 also where it does not say.
        window_size: bytes a decoder must keep.
        dictionary: id, 0 for none.
        checksum: whether a checksum follows the content.
    """

    content_size: int
    window_size: int
    dictionary: int
    checksum: bool


def frame_header(frame: bytes, field: str) -> FrameHeader:
    """The header of `frame`.

    Raises:
        Malformed: ``bad-zstd`` for no frame, a header that is cut, or its reserved bit.
    """
    at = 0

    def number(size: int) -> int:
        nonlocal at
        at += size
        if at > len(frame):
            raise Malformed("bad-zstd", "the header of a zstd frame is cut", field=field)
        return int.from_bytes(frame[at - size : at], "little")

    if number(4) != _MAGIC:
        raise Malformed("bad-zstd", "not a zstd frame", field=field)
    descriptor = number(1)
    if descriptor & _RESERVED:
        raise Malformed("bad-zstd", "a reserved bit of a zstd frame is 1", field=field)
    single = bool(descriptor & _SINGLE_SEGMENT)
    window = 0 if single else _window(number(1))
    dictionary = number(_DICTIONARY_BYTES[descriptor & 3])
    size_bytes = _SIZE_BYTES[descriptor >> 6] or int(single)
    size = number(size_bytes) + (256 if size_bytes == 2 else 0)
    return FrameHeader(size, size if single else window, dictionary, bool(descriptor & _CHECKSUM))


def _window(descriptor: int) -> int:
    base = 1 << (10 + (descriptor >> 3))
    return base + base // 8 * (descriptor & 7)


def frame_fields(frame: bytes) -> Iterator[tuple[str, int, int, Any]]:
    """(name, start, past, value) of each field of `frame` and its blocks, in order, as far as they go.

    Fields of no bytes are left out; so is what follows a field that the frame is too short for.
    """
    at = 0
    if len(frame) < 5 or int.from_bytes(frame[:4], "little") != _MAGIC:
        return
    descriptor = frame[4]
    single = bool(descriptor & _SINGLE_SEGMENT)
    head = (
        ("magic", 4),
        ("descriptor", 1),
        ("window", 0 if single else 1),
        ("dictionary", _DICTIONARY_BYTES[descriptor & 3]),
        ("content_size", _SIZE_BYTES[descriptor >> 6] or int(single)),
    )
    for name, size in head:
        if size and at + size <= len(frame):
            data = frame[at : at + size]
            yield name, at, at + size, data if name == "magic" else int.from_bytes(data, "little")
        at += size
    yield from _block_fields(frame, at, bool(descriptor & _CHECKSUM))


def _block_fields(frame: bytes, at: int, checksum: bool) -> Iterator[tuple[str, int, int, Any]]:
    number, last = 0, False
    while not last and at + 3 <= len(frame):
        head = int.from_bytes(frame[at : at + 3], "little")
        last, kind, size = bool(head & 1), _BLOCK_KINDS[head >> 1 & 3], head >> 3
        yield f"block[{number}].head", at, at + 3, f"{kind}, {size} bytes" + (", last" if last else "")
        at += 3
        stored = 1 if kind == "repeated" else size
        if at + stored > len(frame):
            return
        if stored:
            yield f"block[{number}].data", at, at + stored, frame[at : at + stored]
        at, number = at + stored, number + 1
    if last and checksum and at + 4 <= len(frame):
        yield "checksum", at, at + 4, int.from_bytes(frame[at : at + 4], "little")
