"""For any bytes a result or a ScarError: damaged files of every kind, in every way they can be asked for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scarfmt_conformance.archive import read

from fuzz.corpus import corpus
from fuzz.target import decode_all, dump_all, truncated, validate_all
from fuzz.testing.mutators import Mutant, mutate
from fuzz.testing.strategies import mutants, scenes
from reference_decoder.decode import decode
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.source import BytesSource
from scarfmt.errors import ScarError, Truncated
from scarfmt.tools.inspection import inspect
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate

WORKED = read("worked")


@settings(deadline=None, max_examples=50)
@given(mutants())
def test_damaged_files_of_random_scenes(mutant: Mutant) -> None:
    """Whole, partly, validated, truncated, annotated and inspected; what decoding refuses is not valid."""
    refusal = decode_all(mutant.data)
    assert not (refusal and not validate_all(mutant.data))
    truncated(mutant.data)
    dump_all(mutant.data)
    for act in (_inspect, _partly):
        try:
            act(mutant.data)
        except ScarError:
            continue


def _inspect(data: bytes) -> None:
    inspect(BytesSource(data), metadata=True)


def _partly(data: bytes) -> None:
    decode(data, layers=1, attributes=["scales", "latents"], allow_truncated=True)
    decode(data, box=((0, 0, 0), (1, 1, 1)), tiles=[0], allow_truncated=True)


def test_damaged_files_of_the_corpus() -> None:
    """A short form of the campaign."""
    files = corpus()
    datas = [file.data for file in files]
    for seed in range(250):
        data = mutate(datas[seed % len(datas)], seed, datas).data
        refusal = decode_all(data)
        assert not (refusal and not validate_all(data)), (files[seed % len(files)].name, seed)
        assert not (dump_all(data) and not validate_all(data)), (files[seed % len(files)].name, seed)


@settings(deadline=None, max_examples=300)
@given(st.binary(max_size=400), st.booleans())
def test_random_bytes(data: bytes, signed: bool) -> None:
    """Bytes of no file, with and without a file's first bytes."""
    assert decode_all(WORKED[:16] + data if signed else data)


def test_every_prefix_is_refused_or_gives_whole_layers() -> None:
    """A cut file is never taken for a whole one; on request its whole layers are exactly those of the file."""
    data = WORKED
    whole = [decode(data, layers=layers) for layers in (1, 2)]
    for size in range(len(data)):
        with pytest.raises(Truncated):
            decode(data[:size])
        try:
            found = decode(data[:size], allow_truncated=True)
        except Truncated:
            continue
        wanted = whole[found.layers - 1]
        assert all(map(np.array_equal, found.arrays(), wanted.arrays()))


@settings(deadline=None, max_examples=12)
@given(scenes(max_anchors=30))
def test_sound_files_are_valid_and_cut_files_decode_alike(scene: QuantisedScene) -> None:
    """decode(truncate(f, k)) == decode(f, layers=k), and both validate."""
    data = write_scene(scene)
    result = validate(BytesSource(data))
    assert result.findings == []
    assert result.layers_readable == result.layers_checked == result.layers_declared == len(scene.model.layers)
    assert result.tiles_decoded == len(scene.tiles)
    for layers in range(1, len(scene.model.layers) + 1):
        cut = truncate(BytesSource(data), layers)
        assert validate(BytesSource(cut)).valid
        assert all(map(np.array_equal, decode(cut).arrays(), decode(data, layers=layers).arrays()))
