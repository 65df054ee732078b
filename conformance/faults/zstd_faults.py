"""Files whose Zstandard frames break one rule (SPEC §5.8), and frames that look odd but are allowed.

Frames are put together here byte by byte (RFC 8878): no library writes most of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from conformance.scenes.cases import Case, refused
from conformance.surgery.files import stored_frame
from conformance.surgery.parts import block_with, remade, taken_apart

MAGIC = bytes.fromhex("28b52ffd")
_SKIPPABLE = bytes.fromhex("502a4d18")
_TABLES, _DECODER_MLP = 2, 4
_MIB = 1 << 20
_RLE, _RAW, _COMPRESSED, _RESERVED = 1, 0, 2, 3
_BLOCK = 1 << 17


def zstd_block(kind: int, size: int, body: bytes, last: bool = True) -> bytes:
    """One block of a frame: `size` is what the header says."""
    return (size << 3 | kind << 1 | last).to_bytes(3, "little") + body


def zstd_frame(
    size: int | None, blocks: bytes, *, window: int | None = None, dictionary: bytes = b"", flags: int = 0
) -> bytes:
    """A frame.

    Args:
        size: content size stated, in 8 bytes; None for none.
        blocks: what follows the frame header.
        window: the window descriptor; None for a single-segment frame.
        dictionary: the dictionary id, 0, 1, 2 or 4 bytes.
        flags: more bits of the frame header descriptor: 4 is content checksum, 8 reserved.
    """
    descriptor = flags | (0xC0 if size is not None else 0) | (0x20 if window is None else 0)
    descriptor |= {0: 0, 1: 1, 2: 2, 4: 3}[len(dictionary)]
    head = bytes([descriptor]) + (b"" if window is None else bytes([window])) + dictionary
    return MAGIC + head + (b"" if size is None else size.to_bytes(8, "little")) + blocks


def rle_blocks(size: int) -> bytes:
    """Blocks of `size` zeros."""
    sizes = [_BLOCK] * (size // _BLOCK) + ([size % _BLOCK] if size % _BLOCK else [])
    return b"".join(zstd_block(_RLE, part, b"\0", row == len(sizes) - 1) for row, part in enumerate(sizes))


def window_of(log2: int) -> int:
    """The descriptor of a window of 2^log2 bytes."""
    return (log2 - 10) << 3


def raw_block(content: bytes, last: bool = True) -> bytes:
    """A raw block."""
    return zstd_block(_RAW, len(content), content, last)


def content_of(base: bytes, kind: int) -> bytes:
    """The content of the first block of `kind`: its frame is a stored one of one block, of less than 256 bytes."""
    parts = taken_apart(base)
    frame = parts.blocks[parts.row(kind)]
    if len(frame) != 9 + frame[5] or frame != stored_frame(frame[9:]):
        raise ValueError("not a stored frame of one small block")
    return frame[9:]


def with_frame(base: bytes, kind: int, frame: bytes) -> bytes:
    """The file with another frame as the first block of `kind`."""
    return remade(base, block_with(kind, frame))


def zstd_faults(base: bytes) -> Iterator[Case]:
    """The frame of the first TABLES or DECODER_MLP block of `base` replaced."""
    content = content_of(base, _TABLES)
    for name, purpose, rule, refusal, frame in (
        *_head_faults(content), *_size_faults(content), *_end_faults(content), *_body_faults(content)
    ):
        yield refused(f"zstd-{name}", purpose, rule, refusal, with_frame(base, _TABLES, frame), "models")
    yield refused("zstd-network-17-mib", "a DECODER_MLP frame of 16 MiB and a byte, all zeros", "R-5.8-2",
                  "content-limit", with_frame(base, _DECODER_MLP, zstd_frame(
                      16 * _MIB + 1, rle_blocks(16 * _MIB + 1), window=window_of(20))), "models")


Fault = tuple[str, str, str, str, bytes]


def _head_faults(content: bytes) -> Iterator[Fault]:
    size, body = len(content), raw_block(content)
    yield "no-size", "no content size", "R-5.8-1", "bad-zstd", zstd_frame(None, body, window=window_of(20))
    yield ("empty", "a content of no bytes", "R-5.8-1", "bad-zstd", zstd_frame(0, raw_block(b"")))
    yield ("dictionary", "a dictionary id that no content needs", "R-5.8-1", "bad-zstd",
           zstd_frame(size, body, dictionary=b"\1"))
    # The low four bytes of XXH64 of the content would follow: any four do, as the frame is refused for having them.
    yield ("checksum", "a content checksum", "R-5.8-1", "bad-zstd", zstd_frame(size, body + bytes(4), flags=4))
    yield ("reserved-bit", "the reserved bit of the frame header descriptor", "R-5.8-4", "bad-zstd",
           zstd_frame(size, body, flags=8))
    yield ("reserved-bit-large", "the reserved bit, and more content stated than there may be: the bit comes first",
           "R-5.8-4", "bad-zstd", zstd_frame(64 * _MIB + 1, body, flags=8))
    yield ("magic", "the magic number of the frames before version 0.8", "R-5.8-4", "bad-zstd",
           bytes.fromhex("27b52ffd") + zstd_frame(size, body)[4:])


def _size_faults(content: bytes) -> Iterator[Fault]:
    size, body = len(content), raw_block(content)
    yield ("1-tib", "1 TiB declared in a few bytes", "R-5.8-2", "content-limit", zstd_frame(1 << 40, body))
    yield ("2-63", "2^63 + 47 bytes declared: negative as i64", "R-5.8-2", "content-limit",
           zstd_frame((1 << 63) + 47, body, window=window_of(20)))
    large = 64 * _MIB + 1
    yield ("64-mib", "64 MiB and a byte, all zeros, in a small window", "R-5.8-2", "content-limit",
           zstd_frame(large, rle_blocks(large), window=window_of(20)))
    yield ("window-16-mib", "a window of 16 MiB for a small content", "R-5.8-3", "bad-zstd",
           zstd_frame(size, body, window=window_of(24)))
    yield ("window-9-mib", "a window of 9 MiB: the mantissa of the descriptor counts", "R-5.8-3", "bad-zstd",
           zstd_frame(size, body, window=window_of(23) | 1))
    single = 8 * _MIB + 1
    yield ("window-single", "a single-segment frame of 8 MiB and a byte", "R-5.8-3", "bad-zstd",
           zstd_frame(single, rle_blocks(single)))
    yield ("size-less", "one byte less stated than there is", "R-5.8-4", "bad-zstd",
           zstd_frame(size - 1, body, window=window_of(20)))
    yield ("size-more", "one byte more stated than there is, in a frame with a window", "R-5.8-4", "bad-zstd",
           zstd_frame(size + 1, body, window=window_of(20)))


def _end_faults(content: bytes) -> Iterator[Fault]:
    frame = stored_frame(content)
    yield ("frames-two", "the frame twice", "R-5.8-4", "bad-zstd", frame + frame)
    half = len(content) // 2
    yield ("frames-halves", "the content in two frames", "R-5.8-4", "bad-zstd",
           stored_frame(content[:half]) + stored_frame(content[half:]))
    skip = _SKIPPABLE + (3).to_bytes(4, "little") + b"abc"
    yield "skippable", "a skippable frame only", "R-5.8-4", "bad-zstd", skip
    yield "skippable-first", "a skippable frame before the frame", "R-5.8-4", "bad-zstd", skip + frame
    yield "skippable-after", "a skippable frame after the frame", "R-5.8-4", "bad-zstd", frame + skip
    yield "cut", "the last byte of the frame is missing", "R-5.8-4", "bad-zstd", frame[:-1]
    yield "header-cut", "the frame ends inside its header", "R-5.8-4", "bad-zstd", frame[:5]


def _body_faults(content: bytes) -> Iterator[Fault]:
    size = len(content)
    bodies: dict[str, tuple[str, Callable[[], bytes]]] = {
        "block-reserved": ("a block of the reserved type 3", lambda: zstd_block(_RESERVED, size, content)),
        "block-not-last": ("no block is marked as the last", lambda: zstd_block(_RAW, size, content, last=False)),
        "block-garbage": ("a compressed block that is none", lambda: zstd_block(_COMPRESSED, 4, b"\xff" * 4)),
    }
    for name, (purpose, body) in bodies.items():
        yield name, purpose, "R-5.8-4", "bad-zstd", zstd_frame(size, body())
