"""A scene in another format equals the original within that format's rounding, and what it cannot hold is reported."""

from __future__ import annotations

import gzip
import io
import json
import struct
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scarfmt.container.registries import ColourSpace, CoordinateFrame
from scarfmt.errors import InvalidInput
from scarfmt.formats import output
from scarfmt.formats.clean import keep_edges
from scarfmt.formats.compressed_ply import morton_order
from scarfmt.formats.frame import RUB_TO_RDF, flip_axes
from scarfmt.formats.output import Described, Written
from scarfmt.formats.outputs import OUTPUTS, write_parts
from scarfmt.formats.quantise import SH_C0, opacities, unit_quaternions
from scarfmt.formats.spz import SpzOptions
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene
from tests.formats.scene_files import odd_scene, odd_scenes, read_scene
from tests.samples.codec_samples import refuses

FLOAT_STEP = 2.0**-23
QUANTISED = ("compressed-ply", "spz")


def written(
    format_id: str, scene: GaussianScene, options: SpzOptions | None = None, parts: int = 1, **described: Any
) -> tuple[bytes, Written]:
    """A scene in so many parts, in RDF and sRGB unless `described` says otherwise."""
    out = io.BytesIO()
    frame, space = described.get("frame", CoordinateFrame.RDF), described.get("space", ColourSpace.SRGB)
    step = -(-len(scene) // parts)
    pieces = [scene.rows(slice(at, at + step)) for at in range(0, len(scene), step)]
    said = Described(scene.sh_degree, frame, Description(colour_space=space))
    done = write_parts(format_id, pieces, said, out, options)
    return out.getvalue(), done


def there_and_back(format_id: str, scene: GaussianScene, options: SpzOptions | None = None, **of: Any) -> GaussianScene:
    return read_scene(written(format_id, scene, options, **of)[0])


def wide(scene: GaussianScene) -> GaussianScene:
    """The scene with Gaussians that are wider than the steps of a chunk: others are refused."""
    return replace(scene, log_scales=scene.log_scales + 16)


def turned_by(a: GaussianScene, b: GaussianScene) -> np.ndarray:
    """How far apart unit quaternions of the two scenes are, whatever their signs."""
    p, q = unit_quaternions(a.rotations), unit_quaternions(b.rotations)
    return np.minimum(np.linalg.norm(p - q, axis=1), np.linalg.norm(p + q, axis=1))


@settings(max_examples=40)
@given(odd_scenes)
def test_gltf_keeps_floats(scene: GaussianScene) -> None:
    """Positions and harmonics bit for bit, the rest to the rounding of an exponential or a sigmoid in float32."""
    back = there_and_back("glb", scene)
    np.testing.assert_array_equal(back.positions, scene.positions)
    np.testing.assert_array_equal(back.sh, scene.sh)
    assert turned_by(back, scene).max() < 4 * FLOAT_STEP
    np.testing.assert_allclose(opacities(back.opacity_logits), opacities(scene.opacity_logits), atol=FLOAT_STEP, rtol=0)
    flat = scene.log_scales < -100
    np.testing.assert_allclose(back.log_scales[~flat], scene.log_scales[~flat], atol=16 * FLOAT_STEP, rtol=0)
    assert (back.log_scales[flat] < -103).all()


@settings(max_examples=40)
@given(odd_scenes, st.sampled_from([3, 4]), st.integers(1, 8), st.integers(1, 8))
def test_spz_rounds_to_its_steps(scene: GaussianScene, version: int, first: int, rest: int) -> None:
    scene, options = wide(scene), SpzOptions(version, None, (first, rest))
    back = there_and_back("spz", scene, options)
    bits = 9  # of 24: reaches 16,384
    farthest = np.abs(scene.positions).max()
    while round(farthest * 2 ** (bits + 1)) < 2**23 and bits < 24:
        bits += 1
    np.testing.assert_allclose(back.positions, scene.positions, atol=2.0 ** -(bits + 1), rtol=0)
    log_scales = np.clip(scene.log_scales, -10, 255 / 16 - 10)
    np.testing.assert_allclose(back.log_scales, log_scales, atol=1 / 32 + 1e-5, rtol=0)
    np.testing.assert_allclose(
        opacities(back.opacity_logits), opacities(scene.opacity_logits), atol=0.5 / 255 + 1e-6, rtol=0
    )
    colours = np.clip(scene.sh[:, 0], -0.5 / 0.15, 0.5 / 0.15)
    np.testing.assert_allclose(back.sh[:, 0], colours, atol=0.5 / 255 / 0.15 + 1e-5, rtol=0)
    for part, sh_bits in ((slice(1, 4), first), (slice(4, None), rest)):
        step = max(2 ** (8 - sh_bits) / 2, 1) / 128
        np.testing.assert_allclose(back.sh[:, part], np.clip(scene.sh[:, part], -1, 1), atol=step + 1e-6, rtol=0)
    # Half a step of each of three, and as much again, times sqrt(3) at most, for the fourth that follows from them.
    assert turned_by(back, scene).max() < 2 * np.sqrt(3) * 0.5 * np.sqrt(0.5) / 511 * 1.1


@settings(max_examples=40)
@given(odd_scenes)
def test_compressed_ply_rounds_within_the_bounds_of_its_chunks(scene: GaussianScene) -> None:
    scene = wide(scene)
    back, source = there_and_back("compressed-ply", scene), scene.take(morton_order(scene.positions))
    log_scales = np.clip(source.log_scales.astype(np.float64), -20, 20)
    for start in range(0, len(scene), 256):
        rows = slice(start, start + 256)
        for ours, theirs in ((back.positions, source.positions), (back.log_scales, log_scales)):
            span = np.ptp(theirs[rows], axis=0)
            bound = span / np.array([2047, 1023, 2047]) / 2 * 1.001 + np.abs(theirs[rows]).max() * FLOAT_STEP
            assert (np.abs(ours[rows] - theirs[rows]) <= bound).all()
        span = np.ptp(source.sh[rows, 0], axis=0)
        assert (np.abs(back.sh[rows, 0] - source.sh[rows, 0]) <= span / 510 * 1.001 + 1e-5).all()
    np.testing.assert_allclose(
        opacities(back.opacity_logits), opacities(source.opacity_logits), atol=0.5 / 255 + 1e-6, rtol=0
    )
    # The lowest and the highest of 256 bins are read as their outer ends, the others as their middles.
    np.testing.assert_allclose(back.sh[:, 1:], np.clip(source.sh[:, 1:], -4, 4), atol=1 / 32 + 1e-6, rtol=0)
    assert turned_by(back, source).max() < 2 * np.sqrt(3) * 0.5 * np.sqrt(2) / 1023 * 1.1


@pytest.mark.parametrize("format_id", ["ply", "spz", "glb"])
def test_parts_make_the_file_of_the_whole(format_id: str) -> None:
    """Bounded memory changes no byte."""
    scene = odd_scene(1, 700, 2)
    whole, cut = (written(format_id, scene, parts=parts)[0] for parts in (1, 5))
    assert whole == cut


def test_parts_of_a_compressed_ply_fill_its_chunks() -> None:
    """A chunk may take Gaussians of two parts: all but the last have 256."""
    scene = wide(odd_scene(1, 700, 1))
    out, done = written("compressed-ply", scene, parts=7)
    back = read_scene(out)
    assert b"element chunk 3\n" in out
    assert len(back) == done.count == 700


@pytest.mark.parametrize("format_id", ["spz", "glb", "compressed-ply"])
def test_memory_does_not_grow_with_parts(format_id: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(output, "_MEMORY_BYTES", 1 << 16)
    part = odd_scene(2, 4000, 1)
    peaks = []

    def parts(count: int) -> Iterator[GaussianScene]:
        for _ in range(count):
            yield part

    for count in (20, 80):
        tracemalloc.start()
        with (tmp_path / f"{count}").open("wb") as target:
            write_parts(format_id, parts(count), Described(1), target)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.25 * peaks[0]


@pytest.mark.parametrize("format_id", ["spz", "glb"])
def test_axes_of_the_scene_are_turned_to_those_of_the_format(format_id: str) -> None:
    """Readers give RDF: a scene said to be RUB comes back turned, bit for bit as far as the format goes."""
    scene = odd_scene(3, 50, 3)
    as_rdf = there_and_back(format_id, flip_axes(scene, RUB_TO_RDF))
    as_rub = there_and_back(format_id, scene, frame=CoordinateFrame.RUB)
    np.testing.assert_array_equal(as_rub.positions, as_rdf.positions)
    np.testing.assert_array_equal(as_rub.sh, as_rdf.sh)
    np.testing.assert_array_equal(as_rub.rotations, as_rdf.rotations)


@pytest.mark.parametrize("format_id", ["spz", "glb"])
def test_axes_that_nobody_named_are_said(format_id: str) -> None:
    _, done = written(format_id, odd_scene(3, 5, 0), frame=CoordinateFrame.UNSPECIFIED)
    assert any("axes" in note for note in done.notes)


def test_linear_colours_are_named_by_gltf_and_said_of_others() -> None:
    scene = odd_scene(3, 5, 0)
    out, done = written("glb", scene, space=ColourSpace.LINEAR)
    assert b"lin_rec709_display" in out
    assert not any("linear" in note for note in done.notes)
    for format_id in QUANTISED:
        assert any("linear" in note for note in written(format_id, scene, space=ColourSpace.LINEAR)[1].notes)


def test_what_a_format_changed_beyond_rounding_is_counted() -> None:
    scene = odd_scene(4, 10, 1)
    scene.log_scales[:] = 3.0
    scene.log_scales[:3, 1] = (-11.0, 7.0, -400.0)
    scene.sh[:] = 0.0
    scene.sh[4, 0, 2] = 3.5
    scene.sh[5:7, 2, 1] = -4.5
    spz, ply, glb = (written(format_id, scene)[1].notes for format_id in ("spz", "compressed-ply", "glb"))
    assert [note.partition(": ")[2] for note in spz[1:]] == [f"{count} of 10 Gaussians" for count in (3, 1, 2)]
    assert [note.partition(": ")[2] for note in ply[1:]] == [f"{count} of 10 Gaussians" for count in (1, 2)]
    assert [note.partition(": ")[2] for note in glb] == ["1 of 10 Gaussians"]


@pytest.mark.parametrize("format_id", ["compressed-ply", "spz", "glb"])
def test_values_that_are_not_finite_and_empty_scenes_are_refused(format_id: str) -> None:
    scene = odd_scene(5, 3, 1)
    scene.sh[1, 2, 0] = np.nan
    with pytest.raises(InvalidInput) as caught:
        written(format_id, scene)
    assert caught.value.refusal == "output-range"
    assert "Gaussian 1 " in str(caught.value)
    for parts in ([], [scene.take(np.zeros(0, np.int64))]):
        refuses("output-empty", lambda parts=parts: write_parts(format_id, parts, Described(1), io.BytesIO()))


@pytest.mark.parametrize("format_id", ["compressed-ply", "spz", "glb", "splat", "sog"])
def test_infinities_that_mean_something_are_written(format_id: str) -> None:
    """Scenes that were not cleaned have them: `load` keeps what a file says."""
    scene = odd_scene(5, 3, 1)
    scene.opacity_logits[:2] = np.inf, -np.inf
    scene.log_scales[2, 0] = -np.inf
    finite = keep_edges(scene)[0]
    assert written(format_id, scene)[0] == written(format_id, finite)[0]


@pytest.mark.parametrize(
    ("format_id", "options", "place"),
    [("spz", None, 1e8), ("spz", SpzOptions(4, 12), 2048.0), ("glb", None, 1e39), ("compressed-ply", None, -1e39)],
)
def test_positions_beyond_reach_are_refused(format_id: str, options: SpzOptions | None, place: float) -> None:
    scene = odd_scene(6, 3, 0, reach=1.0)
    scene.positions[2, 1] = place
    refuses("output-range", lambda: written(format_id, scene, options))


@pytest.mark.parametrize("format_id", ["splat", "glb"])
def test_sizes_beyond_float32_are_counted_and_another_format_is_named(format_id: str) -> None:
    scene = odd_scene(6, 3, 0, reach=1.0)
    scene.log_scales[1, 2] = 100
    with pytest.raises(InvalidInput, match=r"the size of 1 of 3 Gaussians is too large .* write a PLY"):
        written(format_id, scene)


def test_the_refusal_of_a_step_names_one_that_reaches() -> None:
    scene = odd_scene(6, 3, 0, reach=1.0)
    scene.positions[2, 1] = 2048.0
    refuses("output-range", lambda: written("spz", scene, SpzOptions(4, 12)), "at most 11 fractional bits")
    assert there_and_back("spz", scene, SpzOptions(4, 11)).positions[2, 1] == 2048.0
    scene.positions[2, 1] = 1e9
    refuses("output-range", lambda: written("spz", scene), "leave out Gaussians far from all others")


@pytest.mark.parametrize("degree", [0, 3])
def test_spz_headers_are_those_of_the_format(degree: int) -> None:
    """Magic, version, count, degree, fractional bits, flags; in version 4 also its streams and where their table is."""
    scene = odd_scene(7, 9, degree, reach=1.0)
    third = gzip.decompress(written("spz", scene, SpzOptions(3, 12))[0])
    assert struct.unpack_from("<4sIIBBBB", third) == (b"NGSP", 3, 9, degree, 12, 0, 0)
    assert len(third) == 16 + 9 * (20 + 3 * ((degree + 1) ** 2 - 1))
    fourth = written("spz", scene, SpzOptions(4, 12))[0]
    streams = 6 if degree else 5
    assert struct.unpack_from("<4sIIBBBBI", fourth) == (b"NGSP", 4, 9, degree, 12, 0, streams, 32)
    sizes = struct.unpack_from(f"<{2 * streams}Q", fourth, 32)
    assert sizes[1::2] == (81, 9, 27, 27, 36, 9 * 45)[:streams]
    assert len(fourth) == 32 + 16 * streams + sum(sizes[::2])


def test_a_glb_is_what_the_specification_of_gltf_asks_for() -> None:
    """Chunks on four bytes, lengths that add up, a view for each attribute, least and greatest position."""
    scene = odd_scene(8, 7, 1)
    data = written("glb", scene)[0]
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    assert size % 4 == 0
    document = json.loads(data[20 : 20 + size])
    binary, kind = struct.unpack_from("<I4s", data, 20 + size)
    assert (kind, 28 + size + binary) == (b"BIN\0", len(data))
    assert document["buffers"] == [{"byteLength": binary}]
    primitive = document["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0
    assert primitive["extensions"]["KHR_gaussian_splatting"]["kernel"] == "ellipse"
    offset = 0
    for view, accessor in zip(document["bufferViews"], document["accessors"], strict=True):
        assert view["byteOffset"] == offset
        assert accessor["count"] == 7
        assert view["byteLength"] % 28 == 0
        offset += view["byteLength"]
    assert offset == binary
    position = document["accessors"][primitive["attributes"]["POSITION"]]
    stored = scene.positions * (-1, -1, 1)
    ends = (stored.min(axis=0).tolist(), stored.max(axis=0).tolist())
    assert (position["min"], position["max"]) == ends
    colour = document["accessors"][primitive["attributes"]["COLOR_0"]]
    assert (colour["componentType"], colour["type"], colour["normalized"]) == (5121, "VEC4", True)


def test_vertex_colours_are_linear_light_and_opacity() -> None:
    """glTF has linear vertex colours: 0.5 of sRGB is 0.2140, and linear colours stay as they are."""
    scene = odd_scene(9, 1, 0)
    scene.sh[0, 0] = ((0.0 - 0.5) / SH_C0, 0.0, (1.0 - 0.5) / SH_C0)
    scene.opacity_logits[0] = 0.0
    for space, grey in ((ColourSpace.SRGB, 55), (ColourSpace.LINEAR, 128)):
        data = written("glb", scene, space=space)[0]
        size = struct.unpack_from("<I", data, 12)[0]
        assert list(data[28 + size + 12 :][:4]) == [0, grey, 255, 128]


def test_unknown_formats_are_refused_with_the_list() -> None:
    with pytest.raises(InvalidInput, match="compressed-ply, ply, spz, glb, gltf") as caught:
        write_parts("ksplat", [], Described(0), io.BytesIO())
    assert caught.value.refusal == "output-format"
    assert len({output.suffix for output in OUTPUTS}) == len(OUTPUTS)
