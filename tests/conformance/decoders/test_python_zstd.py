"""The readable decoder's Zstandard against the library: contents, what SPEC §5.8 forbids, damage."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest
import zstandard

from conformance.decoders.python.zstd import BadFrame, frame_content

Shape = Callable[[random.Random, int], bytes]


def words(numbers: random.Random, size: int) -> bytes:
    vocabulary = [numbers.randbytes(numbers.randint(2, 12)) for _ in range(150)]
    return b"".join(numbers.choice(vocabulary) for _ in range(size // 2 + 1))[:size]


def skewed(numbers: random.Random, size: int) -> bytes:
    """Few long codes and many short ones: Huffman trees as deep as they come."""
    return bytes(numbers.choices(range(256), weights=[1 / (i + 1) ** 2 for i in range(256)], k=size))


def copies(numbers: random.Random, size: int) -> bytes:
    """Matches at all distances, among them the last ones again: repeated offsets."""
    out = bytearray(numbers.randbytes(4))
    while len(out) < size:
        distance = numbers.choice([1, 2, 3, 7, 64, 1000, numbers.randint(1, len(out))])
        for _ in range(numbers.randint(3, 90)):
            out.append(out[-min(distance, len(out))])
        out += numbers.randbytes(numbers.randint(0, 9))
    return bytes(out[:size])


@pytest.mark.parametrize("shape", [words, skewed, copies])
def test_what_the_library_compresses_comes_back(shape: Shape) -> None:
    """Literals of one and four streams, trees and tables used again, repeated offsets, several blocks."""
    numbers = random.Random(1)
    for size in (1, 5, 6, 255, 257, 1000, 5000, 140_000):
        content = shape(numbers, size)
        for level in (-7, 3, 19) if size < 10_000 else (3,):
            assert frame_content(zstandard.ZstdCompressor(level=level).compress(content)) == content


def test_damaged_frames_are_decompressed_or_refused() -> None:
    """Nothing else is raised, and a content is as long as its frame says."""
    numbers = random.Random(6)
    for i in range(300):
        content = (words, skewed, copies)[i % 3](numbers, 400)
        frame = bytearray(zstandard.ZstdCompressor(level=1 + i % 19).compress(content))
        frame[numbers.randrange(7, len(frame))] ^= 1 << numbers.randrange(8)
        try:
            found = frame_content(bytes(frame))
        except BadFrame:
            continue
        assert len(found) == len(content)
