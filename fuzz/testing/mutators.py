"""Damage to files, reproducible from a number: truncation, lies, bit flips, blocks moved about (see `OPERATORS`).

:func:`mutate` picks an operator by its seed, and in half of the cases makes all checksums right afterwards, so that
what is damaged is reached. Only the standard library is used, and Zstandard to look into frames.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random

from fuzz.testing import block_mutators, field_mutators, page_mutators
from fuzz.testing.field_mutators import NotHere
from fuzz.testing.parts import is_file, resealed
from scarfmt.container.schema import SIGNATURE, VERSION

Operator = Callable[[bytes, Random, Sequence[bytes]], bytes]
"""(file, random numbers, other files) -> damaged file. The file must be sound where it is taken apart."""

SEAL_CHANCE = 0.5
_TRIES = 8
_GARBAGE = 64


def flip_bit(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """One bit anywhere."""
    out = bytearray(data)
    out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def flip_bits(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Two to sixteen bits, anywhere or close together."""
    out = bytearray(data)
    start, width = rng.randrange(len(out)), rng.choice((4, 64, len(out)))
    for _bit in range(rng.randint(2, 16)):
        out[(start + rng.randrange(width)) % len(out)] ^= 1 << rng.randrange(8)
    return bytes(out)


def zero_run(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A run of bytes set to 0."""
    return _run(data, rng, lambda n: bytes(n))


def ones_run(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A run of bytes set to 0xFF."""
    return _run(data, rng, lambda n: b"\xff" * n)


def random_run(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A run of random bytes."""
    return _run(data, rng, rng.randbytes)


def _run(data: bytes, rng: Random, filled: Callable[[int], bytes]) -> bytes:
    start = rng.randrange(len(data))
    length = min(len(data) - start, rng.choice((1, 2, 4, 8, 16, 64, 512, 4096)))
    return data[:start] + filled(length) + data[start + length :]


def truncate_anywhere(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """The first bytes only."""
    return data[: rng.randrange(len(data))]


def garbage_tail(data: bytes, rng: Random, others: Sequence[bytes]) -> bytes:
    """Bytes after the end: random, zeros, or another file."""
    tail = (rng.randbytes(rng.randint(1, _GARBAGE)), bytes(rng.randint(1, _GARBAGE)), rng.choice(others or [data]))
    return data + rng.choice(tail)


def random_body(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """Random bytes after a right signature, or after a right header."""
    if rng.random() < 0.5:
        return SIGNATURE + bytes(VERSION) + rng.randbytes(rng.randint(0, 512))
    length = int.from_bytes(data[12:16], "little")
    return data[:length] + rng.randbytes(max(len(data) - length, 0))


def splice_bytes(data: bytes, rng: Random, others: Sequence[bytes]) -> bytes:
    """The beginning of one file and the end of another."""
    other = rng.choice(others or [data])
    cut = rng.randrange(len(data))
    return data[:cut] + other[min(cut, len(other) - 1) if rng.random() < 0.5 else rng.randrange(len(other)) :]


def move_bytes(data: bytes, rng: Random, _: Sequence[bytes]) -> bytes:
    """A piece lost, repeated, or copied over another."""
    start = rng.randrange(len(data))
    piece = data[start : start + rng.choice((1, 4, 9, 12, 32, 136, 1000))]
    how = rng.randrange(3)
    if how == 0:
        return (data[:start] + data[start + len(piece) :]) or b"\0"
    at = rng.randrange(len(data))
    return data[:at] + piece + data[at if how == 1 else at + len(piece) :]


OPERATORS: dict[str, Operator] = {
    "flip-bit": flip_bit,
    "flip-bits": flip_bits,
    "zero-run": zero_run,
    "ones-run": ones_run,
    "random-run": random_run,
    "truncate-anywhere": truncate_anywhere,
    "garbage-tail": garbage_tail,
    "random-body": random_body,
    "splice-bytes": splice_bytes,
    "move-bytes": move_bytes,
    **field_mutators.OPERATORS,
    **page_mutators.OPERATORS,
    **block_mutators.OPERATORS,
}
"""All operators by name."""

_NAMES = tuple(OPERATORS)


@dataclass(frozen=True)
class Mutant:
    """A damaged file and how it came about.

    Attributes:
        data: its bytes.
        operators: names, in the order they were applied.
        sealed: whether checksums were made right afterwards.
    """

    data: bytes
    operators: tuple[str, ...]
    sealed: bool


def mutate(data: bytes, seed: int, others: Sequence[bytes] = (), operator: str | None = None) -> Mutant:
    """A damaged copy of a sound file; equal arguments give equal bytes.

    Args:
        data: a sound file.
        seed: chooses operators and what they do.
        others: files that blocks or bytes may be taken from.
        operator: apply only this one, once.
    """
    rng = Random(seed)
    sealed = rng.random() < SEAL_CHANCE
    if operator is not None:
        names: list[str] = [operator]
    else:
        names = [rng.choice(_NAMES) for _ in range(rng.choice((1, 1, 1, 1, 2, 3)))]
    out, done = data, []
    for name in names:
        changed = _applied(name, out, rng, others)
        if changed is None:
            continue
        out = changed
        done.append(name)
        if not is_file(out):
            break
    return Mutant(resealed(out) if sealed else out, tuple(done), sealed)


def _applied(name: str, data: bytes, rng: Random, others: Sequence[bytes]) -> bytes | None:
    """The result of an operator for a file; None if it finds nothing to work on."""
    try:
        return OPERATORS[name](data, rng, others)
    except (NotHere, ValueError, IndexError, struct.error):  # not a sound file, or no longer
        return None
