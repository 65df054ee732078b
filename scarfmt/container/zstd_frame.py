"""The header of a Zstandard frame (RFC 8878, section 3.1.1.1), read here because SPEC §5.8 orders its checks.

The zstandard package refuses some headers, those of huge windows, before it tells what they say.
"""

from __future__ import annotations

from typing import NamedTuple

from scarfmt.errors import Malformed

_MAGIC = 0xFD2FB528
_SINGLE_SEGMENT, _RESERVED, _CHECKSUM = 1 << 5, 1 << 3, 1 << 2
_DICTIONARY_BYTES = (0, 1, 2, 4)
_SIZE_BYTES = (0, 2, 4, 8)


class FrameHeader(NamedTuple):
    """What a frame says of itself.

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
