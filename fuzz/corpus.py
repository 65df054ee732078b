"""The files that are mutated: conformance vectors and tiny scenes, small ones more often."""

from __future__ import annotations

from dataclasses import dataclass

from scarfmt_conformance.archive import names, read

from conformance.surgery.reseal import is_file
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile

MAX_BYTES = 20_000


@dataclass(frozen=True)
class Seed:
    """A file to be mutated: its id, bytes and whether its parts can be taken (a damaged vector's cannot always)."""

    name: str
    data: bytes


def vectors() -> list[Seed]:
    """Conformance vectors of every class, except those that are cut inside their tables."""
    seeds = (Seed(name, read(name)) for name in names())
    return [seed for seed in seeds if len(seed.data) <= MAX_BYTES and is_file(seed.data)]


def encode_random() -> list[Seed]:
    """Tiny random scenes of both profiles, with and without networks."""
    found = []
    for profile in Profile:
        for seed, anchors, layers, tiles in ((1, 3, 1, 1), (2, 6, 2, 2), (3, 20, 3, 2), (4, 60, 2, 1), (5, 0, 2, 3)):
            scene = random_scene(seed, profile, anchors=anchors, layers=layers, tiles=tiles)
            found.append(Seed(f"scene-{profile.name.lower()}-{seed}", write_scene(scene)))
            neural = neural_scene(seed, profile, anchors=anchors, layers=layers, tiles=tiles)
            found.append(Seed(f"neural-{profile.name.lower()}-{seed}", write_scene(neural)))
    return found


def corpus() -> list[Seed]:
    """All files to mutate, always in the same order."""
    return vectors() + encode_random()
