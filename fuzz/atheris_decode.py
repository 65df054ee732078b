"""Coverage-guided fuzzing with atheris: ``python -m fuzz.atheris_decode CORPUS_FOLDER [libFuzzer flags]``.

The mutator is structure-aware: half of its mutants come from :mod:`fuzz.testing.mutators`, the others from
libFuzzer's own byte mutations, with checksums made right in half of the cases. Only ScarError may come out.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from random import Random

import atheris

with atheris.instrument_imports(include=["scarfmt", "reference_decoder"]):
    from fuzz.target import decoded, dumped, truncated, validated

from conformance.surgery.reseal import is_file, resealed
from fuzz.corpus import corpus
from fuzz.testing.mutators import mutate

MAX_BYTES = 1 << 16
FILES = [seed.data for seed in corpus()]


def one_input(data: bytes) -> None:
    """The function that libFuzzer calls: anything but a return is a finding."""
    decoded(data)
    validated(data)
    dumped(data)
    truncated(data)


def mutator(data: bytes, max_size: int, seed: int) -> bytes:
    """A mutant of `data`, or of a file of the corpus where it has none of the structure left."""
    rng = Random(seed)
    if rng.random() < 0.5:
        base = data if is_file(data) else rng.choice(FILES)
        return mutate(base, rng.getrandbits(32), FILES).data[:max_size]
    changed: bytes = atheris.Mutate(data, len(data) or 1)
    return (resealed(changed) if rng.random() < 0.5 else changed)[:max_size]


def main() -> None:
    """Fill the corpus folder, then fuzz until stopped."""
    warnings.simplefilter("ignore")
    arguments = list(sys.argv)
    if len(arguments) > 1 and not arguments[1].startswith("-"):
        folder = Path(arguments[1])
        folder.mkdir(parents=True, exist_ok=True)
        for number, data in enumerate(FILES):
            (folder / f"seed-{number:03}.scar").write_bytes(data)
    atheris.Setup([*arguments, f"-max_len={MAX_BYTES}", "-timeout=5"], one_input, custom_mutator=mutator)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
