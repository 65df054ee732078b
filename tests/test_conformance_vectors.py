"""The reference reader against the conformance vectors, and the vectors against their generator."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conformance.expectations import Arrays, pinned
from conformance.generate import FORMAT, VECTORS, vectors
from conformance.minimal_decoder import Decoder
from conformance.minimal_fields import Refused
from reference_decoder.decode import decode
from scarfmt.errors import ScarError
from scarfmt.limits import FORMAT_LIMITS
from scarfmt.reader import SceneReader
from scarfmt.schema import Profile, Stream
from scarfmt.source import BytesSource
from scarfmt.truncate import truncate
from scarfmt.validate import validate

FOLDERS = sorted(path.parent for path in VECTORS.glob("**/expect.json"))
ACCEPTED = [folder for folder in FOLDERS if folder.parent.name != "invalid"]
NAMES = [str(folder.relative_to(VECTORS)) for folder in FOLDERS]


def load(folder: Path) -> tuple[bytes, dict[str, Any]]:
    return (folder / "input.scar").read_bytes(), json.loads((folder / "expect.json").read_text())


def decoded(data: bytes, layer: int) -> Arrays:
    """The arrays of expect.json, by the reference reader and decoder."""
    reader = SceneReader(BytesSource(data))
    models = reader.models(layer)
    contents = [content for _, content in reader.tiles(models)]
    whole = decode(data, layers=layer)
    assert whole.positions is not None
    assert whole.indices is not None
    out: Arrays = {
        "tile": whole.tiles.astype("<u4"),
        "class": whole.classes.astype("u1"),
        "position": whole.positions.astype("<f8"),
        "code": np.concatenate([np.zeros(0, "<u8"), *(c.codes.astype("<u8") for c in contents)]),
        "index": whole.indices.astype("<u2"),
    }
    if reader.header.fields.profile == Profile.ANCHOR:
        out["slot_layer"] = np.concatenate([c.slot_layers for c in contents]).astype("u1")
        assert np.array_equal(whole.slots, out["slot_layer"] > 0)
    for index, channel in enumerate(models.model.channels):
        empty = np.zeros((0, *whole_shape(channel.stream, channel.components, reader.header.fields.slots)), "<i4")
        out[f"v.{channel.stream.name}"] = np.concatenate([empty, *(c.values[index].astype("<i4") for c in contents)])
        if channel.stream != Stream.POSITION_RESIDUAL:
            out[f"value.{channel.stream.name}"] = whole.values[channel.stream].astype("<f4")
    if models.decoder is not None:
        out["latent"] = whole.latents.astype("<f4")
    return out


def whole_shape(stream: Stream, components: int, slots: int) -> tuple[int, ...]:
    return (slots, components) if stream == Stream.OFFSETS else (components,)


@pytest.mark.parametrize("folder", FOLDERS, ids=NAMES)
def test_the_reference_agrees_with_the_vector(folder: Path) -> None:
    """Every array of every layer, or the refusal id; the hash of the file shows a damaged checkout."""
    data, expect = load(folder)
    assert expect["format"] == FORMAT
    assert hashlib.sha256(data).hexdigest() == expect["file"]["sha256"]
    if expect["result"] == "refused":
        with pytest.raises(ScarError) as caught:
            decode(data)
        assert caught.value.refusal == expect["refusal"]
        return
    for layer in expect["layers"]:
        arrays = decoded(data, layer["layer"])
        assert len(arrays["code"]) == layer["anchors"]
        assert pinned(arrays) == layer["arrays"]


@pytest.mark.parametrize("folder", FOLDERS, ids=NAMES)
def test_validate_agrees_with_the_vector(folder: Path) -> None:
    """Valid vectors keep every rule, (V) rules too; invalid ones are found out with the same id first."""
    data, expect = load(folder)
    result = validate(BytesSource(data), limits=FORMAT_LIMITS)
    errors = [finding for finding in result.findings if finding.severity == "error"]
    if expect["result"] == "decoded":
        assert not errors
    else:
        assert expect["refusal"] in {finding.refusal for finding in errors}


def test_truncated_vectors_are_what_an_editor_makes() -> None:
    """Byte for byte (SPEC §14)."""
    for folder in FOLDERS:
        data, expect = load(folder)
        if "from" in expect:
            whole = (VECTORS / expect["from"] / "input.scar").read_bytes()
            assert truncate(BytesSource(whole), expect["to_layer"]) == data


def test_the_generator_makes_exactly_the_vectors_committed() -> None:
    """Nothing is edited by hand, nothing is left over, and a second run gives the same bytes."""
    made = {name: (data, json.loads(json.dumps(expect))) for name, data, expect in vectors()}
    assert made == {name: load(folder) for name, folder in zip(NAMES, FOLDERS, strict=True)}


@pytest.mark.parametrize("folder", ACCEPTED, ids=lambda folder: folder.name)
def test_a_decoder_written_from_the_specification_agrees(folder: Path) -> None:
    """SPEC.md's pseudo-code, transcribed without this package, gives the same arrays: the text suffices."""
    data, expect = load(folder)
    for layer in expect["layers"]:
        assert Decoder(data, layer["layer"]).arrays() == layer["arrays"]


@pytest.mark.parametrize("name", sorted(f.name for f in FOLDERS if f.name.startswith(("rice-", "shift-"))))
def test_a_decoder_written_from_the_specification_refuses_bad_rice_codes(name: str) -> None:
    """With the same id: the order of checks in SPEC §5.9 is the package's."""
    data, expect = load(VECTORS / "invalid" / name)
    with pytest.raises(Refused) as caught:
        Decoder(data)
    assert str(caught.value) == expect["refusal"]
