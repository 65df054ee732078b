"""Rules of SPEC.md that no vector can show and no other test checks."""

from __future__ import annotations

import builtins
import json
import os
import socket
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from conformance.decoders.python.front import Root
from conformance.generate import VECTORS
from fuzz.testing.scenes import random_scene
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Block, Container, write_container
from scarfmt.container.schema import BlockKind, Profile
from scarfmt.container.source import BytesSource
from scarfmt.entropy.rice import MAX_PARAMETER, MAX_QUOTIENT, pack_rice, pack_shifted
from scarfmt.errors import ScarError
from scarfmt.tools.inspection import inspect
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate
from tests.conformance.vector_files import FOLDERS, expectation_of, name_of

HEADER_RULES = ("R-5.1-", "R-5.2-", "R-5.3-")


def refused_headers() -> list[tuple[str, bytes, str]]:
    """Vectors that break a rule of the header, but for those of a file that is shorter or a limit that is."""
    out = []
    for folder in FOLDERS:
        expect = expectation_of(folder)
        header = any(rule.startswith(HEADER_RULES) for rule in expect["rules"])
        if expect["result"] == "refused" and header and expect["refusal"] != "truncated-file":
            out.append((name_of(folder), (folder / "input.scar").read_bytes(), expect["refusal"]))
    return out


def test_an_inspector_keeps_the_header_rules() -> None:
    """R-2-5, with the ids a decoder gives."""
    refused = refused_headers()
    assert len(refused) > 50
    for name, data, refusal in refused:
        with pytest.raises(ScarError) as caught:
            inspect(BytesSource(data))
        assert caught.value.refusal == refusal, name


@given(st.lists(st.integers(-3000, 3000) | st.integers(-(1 << 31) + 1, (1 << 31) - 1), max_size=40))
def test_the_parameter_of_a_rice_code_is_the_cheapest(values: list[int]) -> None:
    """R-5.9-4: fewest bits, the smallest of equals."""
    mapped = [2 * value if value >= 0 else -2 * value - 1 for value in values]
    allowed = [k for k in range(MAX_PARAMETER + 1) if all(m >> k <= MAX_QUOTIENT for m in mapped)]
    bits = {k: len(mapped) * (1 + k) + sum(m >> k for m in mapped) for k in allowed}
    assert pack_rice(np.array(values, np.int64))[0] == min(allowed, key=lambda k: (bits[k], k))


@given(st.lists(st.integers(-5, 5), max_size=6), st.integers(0, 28))
def test_the_shift_is_the_largest(values: list[int], power: int) -> None:
    """R-5.9-4: the power of two that divides all numbers, 0 if all are 0."""
    numbers = [value << power for value in values]
    expected = max((s for s in range(32) if all(n % (1 << s) == 0 for n in numbers)), default=0) if any(numbers) else 0
    assert pack_shifted(np.array(numbers, np.int64))[0] == expected


@pytest.mark.parametrize("profile", list(Profile))
def test_no_tile_block_is_written_for_nothing(profile: Profile) -> None:
    """R-7.1-7: each has anchors or sub-streams."""
    for seed in range(6):
        container = Container.open(BytesSource(write_scene(random_scene(seed, profile))))
        tiles = [entry for entry in container.entries if entry.kind == BlockKind.TILE]
        assert tiles
        assert all(entry.count or container.read_block(entry)[0] for entry in tiles)


def test_a_reader_of_one_tile_leaves_other_pages_unread() -> None:
    """R-5.5-11: damage in those is not seen, and what is read is the same."""
    whole = (VECTORS / "edge" / "tile-depths-1" / "input.scar").read_bytes()
    damaged = bytearray(whole)
    place = Root(whole)
    for page in (*place.tile_pages[:20], *place.tile_pages[21:]):
        damaged[page.start] ^= 1
    with pytest.raises(ScarError, match="page-crc-mismatch"):
        Container.open(BytesSource(bytes(damaged))).load()
    readers = [SceneReader(BytesSource(data)) for data in (whole, bytes(damaged))]
    ours, theirs = (next(iter(reader.tiles(reader.models(2, tiles=[20]), [20]))) for reader in readers)
    assert ours[0] == theirs[0] == 20
    assert len(ours[1])
    assert np.array_equal(ours[1].codes, theirs[1].codes)
    assert all(map(np.array_equal, ours[1].values, theirs[1].values))


@pytest.mark.parametrize("profile", list(Profile))
def test_no_table_is_written_for_nothing(profile: Profile) -> None:
    """R-8.3-4: the validator, which warns of such tables, has nothing to say."""
    for seed in range(6):
        assert validate(BytesSource(write_scene(random_scene(seed, profile)))).findings == []


def test_metadata_is_written_sorted_and_without_white_space() -> None:
    """R-7.10-2: by code point, at every depth; a key beyond the basic plane comes after one at its end."""
    value = {"b": [1, {"\U0001f600": 1, "\uffff": 2, "Z": 3}], "a": " kept ", "B": None}
    data = write_scene(replace(random_scene(0), metadata=value))
    container = Container.open(BytesSource(data))
    entry = container.find(BlockKind.METADATA, 1)
    assert entry is not None
    text = container.read_block(entry).decode()
    pairs = json.loads(text, object_pairs_hook=list)
    assert [key for key, _ in pairs] == ["B", "a", "b"]
    assert [key for key, _ in pairs[2][1][1]] == ["Z", "\uffff", "\U0001f600"]
    assert json.loads(text) == value
    assert text.replace(" kept ", "").split() == [text.replace(" kept ", "")]


def test_rules_marked_v_are_reported_after_all_others() -> None:
    """R-12.2-2: counts and sums that a decoder need not compare, found with the first block, are reported last."""
    data = write_scene(random_scene(3, Profile.EXPLICIT))
    container = Container.open(BytesSource(data))
    counts = [(layer.anchor_count, layer.gaussian_count) for layer in container.header.layers]
    blocks = [
        Block(e.kind, e.layer, payload, e.tile, e.count + (e.kind == BlockKind.LAYER), {}, e.flags)
        for e, payload in container.read_blocks(container.entries)
    ]
    wrong = bytearray(write_container(container.header.fields, container.tiles, blocks, counts))
    wrong[-1] ^= 1
    found = [finding.refusal for finding in validate(BytesSource(bytes(wrong))).findings]
    assert found[0] == "crc-mismatch"
    assert set(found[1:]) == {"entry-count", "layer-stream-bytes"}


@pytest.mark.parametrize("name", ["edge/sixteen-layers", "valid/annotations", "valid/index-modes"])
def test_truncating_in_two_steps_is_truncating_at_once(name: str) -> None:
    """R-14-3, for every pair of layers."""
    data = (VECTORS / name / "input.scar").read_bytes()
    layers = Container.open(BytesSource(data)).header.layer_count
    at_once = [truncate(BytesSource(data), k) for k in range(1, layers + 1)]
    for j in range(layers):
        for k in range(j + 1):
            assert truncate(BytesSource(at_once[j]), k + 1) == at_once[k]


def test_nothing_is_opened_because_of_metadata(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:
    """R-15-3: paths and addresses in METADATA stay text, for reader, inspector and validator."""
    value = {"path": f"{tmp_path}/scene", "url": "http://127.0.0.1:9/x", "$ref": "file:///etc/hostname", "import": "os"}
    data = write_scene(replace(random_scene(1), metadata=value))

    def refuse(*_arguments: object, **_options: object) -> None:
        raise AssertionError("something was opened")

    with monkeypatch.context() as patched:
        for module, name in ((builtins, "open"), (os, "open"), (socket, "socket"), (socket, "create_connection")):
            patched.setattr(module, name, refuse)
        report = inspect(BytesSource(data), metadata=True)
        findings = validate(BytesSource(data)).findings
        reader = SceneReader(BytesSource(data))
        models = reader.models()
        decoded = [content for _, content in reader.tiles(models)]
    assert report["metadata"] == value
    assert findings == []
    assert decoded


@settings(max_examples=20)
@given(st.dictionaries(st.text(max_size=5), st.none() | st.integers() | st.text(max_size=5), max_size=5))
def test_metadata_comes_back(value: dict[str, object]) -> None:
    """R-7.10-2: whatever the keys, what is written is read."""
    data = write_scene(replace(random_scene(0, anchors=5, layers=1), metadata=value))
    assert inspect(BytesSource(data), metadata=True)["metadata"] == (value or None)
