"""Valid vectors of many pages: tiles of every depth, pages of any size, pages without blocks (SPEC §5.4, §5.5)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from conformance.scenes.cases import Case, edge
from conformance.scenes.container_scenes import many_pages_file, many_pages_scene, paged_file, paged_scene
from conformance.scenes.made import SCALE3, Plan, build, steady
from conformance.scenes.neural_scenes import neural_plans
from conformance.writer.file import write_file
from conformance.writer.options import WriteOptions
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.file import Tile

_DEEPEST, _LATTICE = 21, 32
_BASES = "R-5.5-7", "R-5.4-11"
_LENGTHS = "R-5.4-12", "R-5.4-15"


def paged_cases() -> Iterator[Case]:
    """Vectors of the class ``valid``."""
    purpose = "seven tiles in pages of two: a page without blocks, two layers with blocks of other pages"
    yield Case("valid/pages", purpose, paged_file(), ("R-5.5-7", "R-5.5-10"), scene=paged_scene())
    plan = replace(neural_plans()["index-deep"][1], seed="pages neural")
    scene = build(plan)
    data = write_file(scene, WriteOptions(page_bits=0))
    yield Case("valid/pages-neural", "an index network over pages of one tile", data, ("R-5.5-7", "R-5.5-10"),
               scene=scene)


def page_cases() -> Iterator[Case]:
    """Vectors of the class ``edge``."""
    tiles = "seven tiles in pages of"
    for bits, what in ((0, "one"), (2, "four"), (16, "65536")):
        yield edge(f"pages-{1 << bits}", f"{tiles} {what}: one page has no blocks, layers have none of another",
                   paged_scene(), _BASES, WriteOptions(page_bits=bits))
    full, last = climbing(), paged_scene()
    for bits in (0, 2):
        yield edge(f"tile-depths-{1 << bits}", f"tiles of every depth beside each other, from 0 to 2^63; pages of "
                   f"{1 << bits}", full, ("R-5.5-6", *_BASES), WriteOptions(page_bits=bits))
    yield edge("tiles-floor", "tiles that begin as soon as their depth lets them, after deeper and shallower ones",
               stairs(), ("R-5.5-6", *_BASES), WriteOptions(page_bits=1))
    yield edge("pages-empty-blocks", "a TILE block for every tile and layer, also where it says nothing", last,
               _LENGTHS, WriteOptions(page_bits=1, empty_tiles=True))
    yield Case("edge/pages-300", "300 pages of one tile, each with a TILE block of five bytes", many_pages_file(300),
               _LENGTHS, ("several-pages",), many_pages_scene(300))


def _place(seed: str, cubes: list[tuple[int, int]], counts: tuple[int, ...]) -> QuantisedScene:
    """A scene of tiles of these depths and prefixes, as many local bits as fit, so many anchors in turn."""
    tiles = tuple(Tile(depth, max(_LATTICE - depth - 21, depth // 2), prefix) for depth, prefix in cubes)
    held = tuple(counts[number % len(counts)] for number in range(len(tiles)))
    return build(Plan(f"pages {seed}", (SCALE3,), steady(2, 0, (1,)), tiles, held, bits=_LATTICE, spread=1))


def climbing() -> QuantisedScene:
    """Cubes that grow from depth 21 at 0 to depth 1 and shrink again to depth 21, the last of which ends at 2^63."""
    low = [(depth, 1) for depth in range(_DEEPEST, 0, -1)]
    high = [(depth, (1 << 3 * depth) - 2) for depth in range(1, _DEEPEST + 1)]
    return _place("depths", [(_DEEPEST, 0), *low, *high, (_DEEPEST, (1 << 3 * _DEEPEST) - 1)], (1, 0, 2))


def stairs() -> QuantisedScene:
    """Every cube begins at the first code of its depth after the cube before, so that no gap shows it."""
    cubes, past = [], 5
    for depth in (21, 3, 21, 17, 2, 21, 20, 1, 4, 21, 1, 9, 21, 2, 13, 1, 21):
        free = 3 * (_DEEPEST - depth)
        prefix = -(-past >> free)
        past = prefix + 1 << free
        cubes.append((depth, prefix))
    return _place("stairs", cubes, (2, 1, 0, 3))
