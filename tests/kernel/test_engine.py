"""Whole files: every conformance vector decoded with the compiled library and without, arrays, counts and refusals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings

from conformance.generate import VECTORS
from fuzz.testing.mutators import Mutant
from fuzz.testing.strategies import files, mutants
from scarfmt.coding.engine import Engine
from scarfmt.coding.reader import SceneReader
from scarfmt.container.source import BytesSource, open_source
from scarfmt.counters import Counters
from tests.conformance.vector_files import FOLDERS, expectation_of, name_of
from tests.kernel.samples import both, needs_kernel, same

pytestmark = needs_kernel

SMALL = [path.read_bytes() for path in sorted(VECTORS.glob("[ve]*/*/input.scar")) if path.stat().st_size < 3000]


def decoded(source: Any, engine: Engine, layers: int | None = None) -> Any:
    """Every array of every tile, and what was counted, of the first `layers` layers; None for all."""
    counters, found = Counters(), list[Any]()
    reader = SceneReader(source, engine=engine)
    models = reader.models(layers, counters)
    for _, content in reader.tiles(models, counters=counters):
        found.append((content.codes, content.classes, content.values, content.first, content.indices))
        found.append(content.slot_layers)
    return found, counters


@pytest.mark.parametrize("folder", FOLDERS, ids=name_of)
def test_every_vector(folder: Path, tmp_path: Path) -> None:
    """Valid and edge ones give equal arrays; the others these, or the same refusal at the same place."""
    expect = expectation_of(folder)
    path = folder / "input.scar"
    if expect.get("extend_to"):
        path = tmp_path / "input.scar"
        path.write_bytes((folder / "input.scar").read_bytes())
        with path.open("r+b") as file:
            file.truncate(expect["extend_to"])

    # Of some, later layers are damaged: no decoder is asked for them.
    layers = expect["layers"][-1]["layer"] if expect["result"] == "decoded" else None

    def act(engine: Engine) -> Any:
        with open_source(str(path)) as source:
            return decoded(source, engine, layers)

    compiled, plain = both(act)
    assert same(compiled, plain)
    if expect["result"] == "decoded":
        assert isinstance(compiled[1], Counters)


@settings(deadline=None, max_examples=60)
@given(files(max_anchors=80))
def test_sound_files(data: bytes) -> None:
    """Random scenes of both profiles have predictors, index network and hash grid."""
    compiled, plain = both(lambda engine: decoded(BytesSource(data), engine))
    assert same(compiled, plain)
    assert isinstance(compiled[1], Counters)


@settings(deadline=None, max_examples=150)
@given(mutants(SMALL))
def test_damaged_files(mutant: Mutant) -> None:
    """With the checksums of some made right again, so that the damage is met where it is."""
    assert same(*both(lambda engine: decoded(BytesSource(mutant.data), engine)))
