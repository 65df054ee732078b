"""Files that we write are read alike by another program: @playcanvas/splat-transform, and its library for SPZ.

`benchmarks.rivals_tools.install` brings it from npm; without it these tests are skipped.
"""

from __future__ import annotations

import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
import zstandard

from benchmarks import rivals_tools
from benchmarks.rivals_tools import run_command, splat_transform
from benchmarks.scenes import REPOSITORY
from reference_decoder.decode import DecodeRequest
from reference_decoder.stream_gaussians import stream_gaussians
from reference_encoder.options import EncodeOptions
from scarfmt.api import encode
from scarfmt.container.source import open_source
from scarfmt.formats.frame import RUB_TO_RDF, flip_axes
from scarfmt.formats.outputs import write_parts
from scarfmt.formats.quantise import opacities
from scarfmt.formats.spz import SpzOptions
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.rotation import matrix_from_quaternion
from tests.formats.scene_files import read_scene

pytestmark = [
    pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed"),
    pytest.mark.skipif(
        not (rivals_tools.CACHE / "driver.mjs").exists(),
        reason='splat-transform is not installed: python -c "from benchmarks.rivals_tools import install; install()"',
    ),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("judged")


@pytest.fixture(scope="module")
def scar(folder: Path) -> Path:
    """The example scene of the repository as a .scar file, and the PLY of that."""
    pytest.importorskip("torch", reason="needs the extra encode")
    options = EncodeOptions(effort=1, corrections=0, layers=2)
    path = folder / "scene.scar"
    path.write_bytes(encode(REPOSITORY / "examples" / "plush-toys.ply", options))
    written(path, "ply").rename(folder / "scene.ply")
    return path


def written(scar: Path, format_id: str, options: SpzOptions | None = None) -> Path:
    """The scene of a .scar file in another format, as `scarfmt decode` writes it."""
    version = "" if options is None else f"-{options.version}"
    path = scar.with_name(f"out{version}.{'compressed.ply' if format_id == 'compressed-ply' else format_id}")
    described, parts = stream_gaussians(open_source(scar), DecodeRequest())
    with path.open("wb") as target:
        write_parts(format_id, parts, described, target, options)
    return path


def through_the_judge(path: Path) -> GaussianScene:
    """The PLY that splat-transform makes of a file."""
    out = path.with_name(f"{path.name}.judged.ply")
    run_command(splat_transform(str(path), str(out)))
    return read_scene(out)


def assert_same(a: GaussianScene, b: GaussianScene, opacity: float = 1e-6) -> None:
    """Equal but for the rounding of float32; of rotations, that ellipsoids have the same axes."""
    for name, tolerance in (("positions", 1e-5), ("log_scales", 1e-5), ("sh", 1e-5)):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=tolerance, rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(opacities(a.opacity_logits), opacities(b.opacity_logits), atol=opacity)
    np.testing.assert_allclose(axes(a.rotations), axes(b.rotations), atol=1e-5)


def axes(quaternions: np.ndarray) -> np.ndarray:
    """Squares and products of the components of each axis, (N, 3, 3, 3): which way an axis points does not count."""
    matrices = matrix_from_quaternion(quaternions)
    return np.asarray(np.einsum("nia,nja->naij", matrices, matrices))


@pytest.mark.parametrize(
    ("format_id", "options"),
    [("ply", None), ("compressed-ply", None), ("spz", SpzOptions(3)), ("spz", SpzOptions(4))],
)
def test_it_reads_our_files_as_we_do(scar: Path, format_id: str, options: SpzOptions | None) -> None:
    """Opacities of 0 and 255 it reads as a little more than nothing and less than all: half a step from ours.

    The outside reader takes the axes of an SPZ for those of a PLY, so it sees the scene turned.
    """
    path = written(scar, format_id, options)
    found = through_the_judge(path)
    found = flip_axes(found, RUB_TO_RDF) if format_id == "spz" else found
    assert_same(found, read_scene(path), 1e-6 if format_id == "ply" else 0.5 / 255 + 1e-6)


def spz_streams(path: Path) -> list[bytes]:
    """Header, then the attributes of an SPZ 4, unpacked."""
    data = path.read_bytes()
    streams, at = struct.unpack_from("<BI", data, 15)
    found, start = [data[:32]], at + 16 * streams
    for index in range(streams):
        size = struct.unpack_from("<Q", data, at + 16 * index)[0]
        found.append(zstandard.ZstdDecompressor().decompress(data[start : start + size]))
        start += size
    return found


def test_our_spz_has_the_bytes_of_the_library_of_the_format(scar: Path) -> None:
    """Axes and steps are equal. Attributes differ only where float32 and float64 round to two neighbours.

    With fewer than 8 bits of harmonics the library rounds twice, to 8 bits first, and we once.
    """
    ply = scar.with_name("scene.ply")
    theirs, ours = scar.with_name("theirs.spz"), scar.with_name("ours.spz")
    run_command(splat_transform(str(ply), str(theirs), SPZ_SH1_BITS="8", SPZ_SH_REST_BITS="8"))
    as_rub = flip_axes(read_scene(ply), RUB_TO_RDF)  # what the writer will turn back
    with ours.open("wb") as target:
        described, _ = stream_gaussians(open_source(scar), DecodeRequest())
        write_parts("spz", [as_rub], described, target, SpzOptions(4, 12, (8, 8)))
    header, *expected = spz_streams(theirs)
    own_header, *found = spz_streams(ours)
    assert own_header == header
    for number, (a, b) in enumerate(zip(found, expected, strict=True)):
        different = np.frombuffer(a, np.uint8) != np.frombuffer(b, np.uint8)
        assert different.mean() < 1e-3, f"attribute {number}"


def gltf_attributes(path: Path) -> dict[str, np.ndarray]:
    """The attributes of a .glb of floats, by name, without a reader of ours."""
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    document, start = json.loads(data[20 : 20 + size]), 28 + size
    found = {}
    for name, index in document["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        at = start + view["byteOffset"]
        body = data[at : at + view["byteLength"]]
        found[name] = np.frombuffer(body, "<f4" if accessor["componentType"] == 5126 else "u1").reshape(
            accessor["count"], -1
        )
    return found


def test_our_glb_has_the_attributes_of_its_glb(scar: Path) -> None:
    """The outside program writes glTF but does not read it. It keeps the length of quaternions, and writes vertex
    colours in sRGB."""
    theirs = scar.with_name("theirs.glb")
    run_command(splat_transform(str(scar.with_name("scene.ply")), str(theirs)))
    expected, found = gltf_attributes(theirs), gltf_attributes(written(scar, "glb"))
    assert found.keys() == expected.keys()
    for name in found.keys() - {"COLOR_0", "KHR_gaussian_splatting:ROTATION"}:
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-5, atol=1e-6, err_msg=name)
    ours, its = (values["KHR_gaussian_splatting:ROTATION"][:, [3, 0, 1, 2]] for values in (found, expected))
    np.testing.assert_allclose(axes(ours), axes(its), atol=1e-5)
    np.testing.assert_array_equal(found["COLOR_0"][:, 3], expected["COLOR_0"][:, 3])


def test_we_read_its_glb_as_the_ply_it_was_made_of(scar: Path) -> None:
    theirs = scar.with_name("theirs-in.glb")
    run_command(splat_transform(str(scar.with_name("scene.ply")), str(theirs)))
    assert_same(read_scene(theirs), read_scene(scar.with_name("scene.ply")))
