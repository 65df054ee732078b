"""Inputs of a campaign: number n of seed S is always the same file, from an equal corpus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from fuzz.corpus import Seed
from fuzz.testing.mutators import Mutant, mutate, mutate_blocks


@dataclass(frozen=True)
class Input:
    """One damaged file and where it comes from."""

    number: int
    file: str
    mutant: Mutant

    @property
    def name(self) -> str:
        """Enough to make it again."""
        return f"{self.number} {self.file} {'+'.join(self.mutant.operators)}{' sealed' if self.mutant.sealed else ''}"


def flip_bit(data: bytes, seed: int, _: list[bytes]) -> Mutant:
    """A single bit flipped, or one byte to nine more or less."""
    rng, out = Random(seed), bytearray(data)
    how = rng.random()
    if how < 0.01:
        return Mutant(data[: rng.randrange(len(out))], ("cut",), False)
    if how < 0.02:
        return Mutant(data + rng.randbytes(rng.randint(1, 9)), ("extended",), False)
    bit = rng.randrange(8 * len(out))
    out[bit // 8] ^= 1 << bit % 8
    return Mutant(bytes(out), ("bit",), False)


KINDS: dict[str, Callable[[bytes, int, list[bytes]], Mutant]] = {
    "mutants": mutate, "deep": mutate_blocks, "bit-flips": flip_bit
}  # fmt: skip
"""Kinds of damage by the name that the command line takes; all but `mutants` need sound files."""


class Inputs:
    """Files of a corpus with damage of one of `KINDS`; called with the number of an input."""

    def __init__(self, files: list[Seed], seed: int, kind: str = "mutants") -> None:
        self._files, self._seed, self._kind = files, seed, kind
        self._datas = [file.data for file in files]
        # Reading takes longer the larger a file is: small ones are where most is learnt in a second.
        self._weights = [1 / (500 + len(data)) for data in self._datas]

    def __call__(self, number: int) -> Input:
        rng = Random(f"{self._kind} {self._seed}/{number}")
        file = rng.choices(self._files, self._weights)[0]
        return Input(number, file.name, KINDS[self._kind](file.data, rng.getrandbits(32), self._datas))
