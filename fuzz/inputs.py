"""Damaged files of a corpus: number n of seed S is always the same file, from an equal corpus."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from random import Random

from fuzz.case import Case
from fuzz.corpus import Seed, corpus
from fuzz.target import decode_all, decode_by, dump_all, truncated, validate_all
from fuzz.testing.mutators import Dice, Mutant, apply, mutate, mutate_blocks

_TRUNCATE_EVERY = 8


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
    """A single bit flipped; no checksum made right."""
    return apply(data, Dice(seed), ["flip-bit"], False)


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


def prepare(kind: str, seed: int, compare: bool) -> Callable[[int], Case]:
    """What makes the inputs of a campaign."""
    files = corpus()
    if kind != "mutants":
        files = [file for file in files if not decode_all(file.data)]
    make = Inputs(files, seed, kind)

    def case(number: int) -> Case:
        one = make(number)
        return Case(one.name, one.mutant.data, partial(examine, one, kind == "bit-flips", compare))

    return case


def examine(one: Input, must_refuse: bool, compare: bool) -> tuple[str, str | None]:
    """Take a file through everything that reads files: the refusal of a decode, and what is wrong.

    Args:
        must_refuse: whether it is a finding if validate takes it.
        compare: whether another answer of NumPy alone is one.
    """
    data = one.mutant.data
    refusal, invalid = decode_all(data), validate_all(data)
    dump_all(data)
    if one.number % _TRUNCATE_EVERY == 0:
        truncated(data)
    # The converse is false, by rules marked (V), and as a decoder reads no block it has no need of (SPEC §5.6).
    if refusal and not invalid:
        return refusal, f"decode refuses {refusal}, validate finds nothing"
    if must_refuse and not invalid:
        return "valid", "unnoticed"
    if compare and decode_by(data, native=True) != decode_by(data, native=False):
        return refusal, "the engines differ"
    return refusal or "decoded", None
