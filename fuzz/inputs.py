"""Inputs of a campaign: number n of seed S is always the same file, from an equal corpus."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

from fuzz.corpus import Seed
from fuzz.testing.mutators import Mutant, mutate
from fuzz.testing.parts import resealed

DEEP = ("frame-content", "model-content", "layer-row", "tile-words", "substream-field", "substreams", "swap-payloads")
"""Operators that change what a file says and leave its structure whole."""


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


class Inputs:
    """Any damage that `fuzz.testing.mutators` knows."""

    def __init__(self, files: list[Seed], seed: int) -> None:
        self._files = files
        self._datas = [file.data for file in files]
        self._seed = seed
        # Reading takes longer the larger a file is: small ones are where most is learnt in a second.
        self._weights = [1 / (500 + len(file.data)) for file in files]

    def __call__(self, number: int) -> Input:
        rng = Random(f"{self._seed}/{number}")
        file = rng.choices(self._files, self._weights)[0]
        return Input(number, file.name, mutate(file.data, rng.getrandbits(32), self._datas))


class DeepMutants(Inputs):
    """Sound files whose models, tables, sub-streams or rANS words say something else, with all checksums right."""

    def __call__(self, number: int) -> Input:
        rng = Random(f"deep {self._seed}/{number}")
        file = rng.choices(self._files, self._weights)[0]
        data, done = file.data, list[str]()
        for operator in rng.choices(DEEP, k=rng.choice((1, 1, 2, 3))):
            one = mutate(data, rng.getrandbits(32), self._datas, operator)
            data, done = one.data, [*done, *one.operators]
        return Input(number, file.name, Mutant(resealed(data), tuple(done), True))


class BitFlips(Inputs):
    """Single bits of sound files flipped, or one byte more or less."""

    def __call__(self, number: int) -> Input:
        rng = Random(f"flip {self._seed}/{number}")
        file = rng.choices(self._files, self._weights)[0]
        out = bytearray(file.data)
        how = rng.random()
        if how < 0.01:
            return Input(number, file.name, Mutant(file.data[: rng.randrange(len(out))], ("cut",), False))
        if how < 0.02:
            return Input(number, file.name, Mutant(file.data + rng.randbytes(rng.randint(1, 9)), ("extended",), False))
        bit = rng.randrange(8 * len(out))
        out[bit // 8] ^= 1 << bit % 8
        return Input(number, file.name, Mutant(bytes(out), ("bit",), False))


KINDS: dict[str, type[Inputs]] = {"mutants": Inputs, "deep": DeepMutants, "bit-flips": BitFlips}
"""By the name that the command line takes."""
