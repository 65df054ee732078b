"""Tiles by the C library: the numbers of the definition, whatever the processor and the number of threads."""

from __future__ import annotations

import ctypes
import mmap
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scarfmt_conformance.archive import names, read

from fuzz.testing.mutators import mutate
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.strategies import quantised_scenes
from reference_decoder.decode import decode
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.schema import BlockKind
from scarfmt.container.source import BytesSource
from scarfmt.errors import ScarError
from scarfmt.native.binding import library
from scarfmt.native.file import NativeFile
from scarfmt.scene.streams import ATTRIBUTES
from tests.samples.equality import same

pytestmark = pytest.mark.skipif(library() is None, reason="no C library")
MOST_PRODUCTS = 4


@pytest.fixture
def products() -> Iterator[ctypes.CDLL]:
    """The library, whose products are the best again afterwards."""
    native = library()
    assert native is not None
    native.scar_products.restype, native.scar_products.argtypes = ctypes.c_char_p, [ctypes.c_int64]
    yield native
    native.scar_products(0)


def test_all_products_give_the_same_integers(products: ctypes.CDLL) -> None:
    """Those of each kind of vectors that this processor has, and the plain ones."""
    files = [read(name) for name in names("valid/*") if "predictor" in name or "index" in name or "neural" in name]
    files.append(write_scene(neural_scene(28, anchors=200, tiles=2, layers=2)))
    wanted = [decode(data, native=False) for data in files]
    kinds = {products.scar_products(some) for some in range(MOST_PRODUCTS)}
    assert len(kinds) > 1 or kinds == {b"plain"}
    for some in range(MOST_PRODUCTS):
        products.scar_products(some)
        for data, found in zip(files, wanted, strict=True):
            assert same(decode(data).arrays(), found.arrays())


PARTS = [{"layers": 1}, {"tiles": [0]}, {"box": ([-1e3] * 3, [0.0] * 3)}]
PARTS += [{"attributes": [name]} for name in ATTRIBUTES]


@settings(deadline=None, max_examples=40)
@given(quantised_scenes(), st.sampled_from(PARTS))
def test_regions_layers_and_attributes(scene: QuantisedScene, part: dict[str, Any]) -> None:
    """Parts of a file are those of the definition."""
    data = write_scene(scene)
    found, wanted = (decode(data, native=native, **part).arrays() for native in (True, False))
    assert same(found, wanted)


def test_threads_share_models() -> None:
    """Files decoded side by side, each on several threads."""
    files = [write_scene(neural_scene(seed, anchors=120, tiles=5)) for seed in range(3)]
    wanted = [decode(data, threads=1) for data in files]
    with ThreadPoolExecutor(4) as pool:
        for found, alone in zip(pool.map(lambda data: decode(data, threads=3), files * 4), wanted * 4, strict=True):
            assert same(found.arrays(), alone.arrays())


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no /proc")
def test_refused_models_leave_no_memory() -> None:
    """A server that is given damaged files does not grow: numbers that break off, two thousand times."""
    reader = SceneReader(BytesSource(read("worked")))
    fields, native = reader.header.fields, library()
    assert native is not None
    blocks = {(entry.layer, entry.kind): data for entry, data in reader.model_payloads(1).items()}
    blocks[1, BlockKind.TABLES] = blocks[1, BlockKind.TABLES][4:]
    used = []
    for _ in range(2):
        for _ in range(2000):
            assert NativeFile(native, fields, reader.header.file_length, 1, blocks).refusal == "rans-seal"
        used.append(int(Path("/proc/self/statm").read_text().split()[1]) * mmap.PAGESIZE)
    assert used[1] - used[0] < 4 << 20


def test_damaged_files_are_answered_as_by_the_definition() -> None:
    """The same values, or the same refusal at the same place."""
    files = [read(name) for name in names("valid/*")]
    for number in range(80):
        data = mutate(files[number % len(files)], number, files).data
        answers = []
        for native in (True, False):
            try:
                answers.append(decode(data, native=native, allow_truncated=True))
            except ScarError as error:
                answers.append((error.refusal, error.offset, error.field))
        if isinstance(answers[0], tuple):
            assert answers[0] == answers[1]
        else:
            assert same(answers[0].arrays(), answers[1].arrays())


@pytest.mark.parametrize("pattern", ["worked", "valid/*", "edge/*", "either/*", "invalid/*"])
def test_the_library_answers_for_models_as_the_definition(pattern: str) -> None:
    """It refuses none that can be read, which nobody would see: the definition decodes what it refuses."""
    native, wrong, seen = library(), [], 0
    assert native is not None
    for name in names(pattern):
        try:
            reader = SceneReader(BytesSource(read(name)))
            layers = len(reader.header.layers)
            payloads = reader.model_payloads(layers)
        except ScarError:
            continue
        try:
            reader.models_of(layers, payloads, [])
            wanted = None
        except ScarError as error:
            wanted = error.refusal
        blocks = {(entry.layer, entry.kind): data for entry, data in payloads.items()}
        found = NativeFile(native, reader.header.fields, reader.header.file_length, layers, blocks).refusal
        seen += 1
        if found != wanted:
            wrong.append((name, found, wanted))
    assert not wrong
    assert seen
