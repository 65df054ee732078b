"""inspect: the report about a file from its header alone."""

from __future__ import annotations

import builtins
import json
import os
import socket
from dataclasses import replace

import numpy as np
import pytest
from scarfmt_conformance.archive import expectation, names, read

from fuzz.testing.scenes import random_scene
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Block, Container, write_container
from scarfmt.container.header import header_length
from scarfmt.container.schema import BlockKind, Profile
from scarfmt.container.source import ByteSource, BytesSource
from scarfmt.errors import LimitExceeded, ScarError, Truncated
from scarfmt.limits import Limits
from scarfmt.tools.inspection import format_text, inspect
from scarfmt.tools.validate import validate
from tests.samples.codec_samples import refuses
from tests.samples.container_samples import COUNTS, FIELDS, TILES, edit, sample_file


class SparseSource(ByteSource):
    """A file of `size` bytes of which only the first exist; reading others fails the test."""

    def __init__(self, head: bytes, size: int) -> None:
        super().__init__(size)
        self._head = head

    def _fetch(self, offset: int, length: int) -> bytes:
        assert offset + length <= len(self._head), "inspect must read the header only"
        return self._head[offset : offset + length]


def test_inspecting_a_gigabyte_reads_the_header_only() -> None:
    """One small read, whatever the file's size."""
    size = 1 << 30
    data = sample_file(1)
    grown = size - len(data)
    data = edit(data, "FILE_HEADER", 0, "file_length", size)
    for field in ("byte_count", "end_offset", "stream_bytes"):
        offset = 100 + {"byte_count": 16, "end_offset": 24, "stream_bytes": 32}[field]
        old = int.from_bytes(data[offset : offset + 8], "little")
        data = edit(data, "LAYER_SUMMARY", 0, field, old + grown)
    source = SparseSource(data[: header_length(1)].ljust(4096, b"\0"), size)
    report = inspect(source)
    assert report["file_bytes"] == size
    assert report["complete"]
    assert source.reads == 1
    assert source.bytes_read <= header_length(16) < 4096


def test_the_report_is_json_and_adds_up() -> None:
    """Numbers a program can use: layers, streams and cumulative sizes agree with the file."""
    data = sample_file()
    report = json.loads(json.dumps(inspect(BytesSource(data)), allow_nan=False))
    assert report["profile"] == "explicit"
    assert (report["coordinate_frame"], report["colour_space"]) == ("rdf", "srgb")
    assert [(layer["anchors"], layer["gaussians"]) for layer in report["layers"]] == COUNTS
    new = [(layer["new_anchors"], layer["new_gaussians"]) for layer in report["layers"]]
    assert new == [tuple(step) for step in np.diff(COUNTS, axis=0, prepend=0).tolist()]
    assert report["front_bytes"] + sum(layer["bytes"] for layer in report["layers"]) == len(data)
    assert report["layers"][-1]["end_offset"] == len(data) == report["file_bytes"]
    for layer in report["layers"]:
        assert sum(layer["streams"].values()) == layer["bytes"]
        assert layer["bytes_per_anchor"] == layer["end_offset"] / layer["anchors"]
        assert all(name in format_text(report) for name, size in layer["streams"].items() if size)
    assert report["bytes_per_anchor"] == len(data) / 100
    assert "metadata" not in report
    anchors = inspect(BytesSource(write_scene(random_scene(1, Profile.ANCHOR))))
    assert f"{anchors['anchors']:,} anchors of {anchors['slots']} slots" in format_text(anchors)


def test_a_cut_file_is_described_with_what_arrived() -> None:
    """inspect helps with a partial download instead of refusing it."""
    data = sample_file()
    end = Container(BytesSource(data)).header.layers[1].end_offset
    report = inspect(BytesSource(data[:end]))
    assert (report["complete"], report["layers_available"], report["bytes_present"]) == (False, 2, end)
    assert "cut short" in format_text(report)
    refuses("truncated-header", lambda: inspect(BytesSource(data[:200])), kind=Truncated)


def test_metadata_only_when_asked() -> None:
    """Metadata needs the directory and a block, so it costs more reads."""
    data = sample_file()
    report = inspect(BytesSource(data), metadata=True)
    assert (report["metadata"], report["thumbnail_bytes"]) == ({"title": "sample"}, 0)
    assert '"title": "sample"' in format_text(report)
    cut = Container(BytesSource(data)).entries[4].end - 1
    assert inspect(BytesSource(data[:cut]), metadata=True)["metadata"] is None
    without = write_container(FIELDS, TILES, [], [(0, 0)])
    assert inspect(BytesSource(without), metadata=True)["metadata"] is None


def test_shown_metadata_cannot_steer_a_terminal() -> None:
    """Control characters beyond ASCII and marks of writing direction are escaped, letters are not."""
    text = '{"a":"\\u009b\\u202eß\\ud83c\\udf0d\\udb40\\udc01"}'
    data = write_container(FIELDS, [], [Block(BlockKind.METADATA, 1, text.encode())], [(0, 0)])
    shown = format_text(inspect(BytesSource(data), metadata=True))
    assert r'"a": "\x9b\u202eß🌍\U000e0001"' in shown


def test_large_metadata_is_refused_unread() -> None:
    """JSON grows when parsed; the cap is on the block."""
    source, limits = BytesSource(sample_file()), Limits(metadata_bytes=18)
    refuses("limit-metadata", lambda: inspect(source, metadata=True, limits=limits), kind=LimitExceeded)


def test_an_empty_scene_has_no_bytes_per_anchor() -> None:
    """No division by zero."""
    report = inspect(BytesSource(write_container(FIELDS, [], [], [(0, 0)])))
    assert report["bytes_per_anchor"] is None
    assert "bytes" in format_text(report)


def test_header_rules_are_kept() -> None:
    """R-2-5: every vector that breaks a rule of the header is refused, with the id a decoder gives."""
    refused = 0
    for name in names():
        expect = expectation(name)
        header = any(rule.startswith(("R-5.1-", "R-5.2-", "R-5.3-")) for rule in expect["rules"])
        if expect["result"] == "refused" and header and expect["refusal"] != "truncated-file":
            with pytest.raises(ScarError) as caught:
                inspect(BytesSource(read(name)))
            assert caught.value.refusal == expect["refusal"], name
            refused += 1
    assert refused > 50


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
