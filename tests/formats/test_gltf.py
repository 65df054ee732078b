"""glTF in: what its attributes, accessors and nodes say, and one clear refusal of what they should not."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scarfmt.container.registries import ColourSpace, RenderModel
from scarfmt.errors import InputWarning, ScarError
from scarfmt.formats import load
from scarfmt.formats.quantise import opacities
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.scene.placement import sh_basis
from scarfmt.scene.rotation import matrix_from_quaternion
from tests.formats.scene_files import EXAMPLES, glb, gltf, gltf_document, read_scene, spz, unit_quaternions
from tests.samples.codec_samples import refuses

NAME = "KHR_gaussian_splatting:{}".format
Document = dict[str, Any]
Change = Callable[[Document], object]


def changed(change: Change, count: int = 4, degree: int = 1) -> bytes:
    document, data = gltf_document(count, degree)
    change(document)
    return glb(document, data)


def primitive(document: Document) -> Document:
    found: Document = document["meshes"][0]["primitives"][0]
    return found


def terms(document: Document) -> Document:
    found: Document = primitive(document)["extensions"]["KHR_gaussian_splatting"]
    return found


def accessor(document: Document, name: str) -> Document:
    found: Document = document["accessors"][primitive(document)["attributes"][name]]
    return found


@pytest.mark.parametrize("kind", [glb, gltf])
def test_values_are_those_of_the_attributes_in_rdf(kind: Callable[[Document, bytes], bytes]) -> None:
    """x and y turn round: x left, y up, z forward becomes x right, y down, z forward."""
    scene = read_scene(kind(*gltf_document(4, 1)))
    row = np.arange(4.0)[:, None]
    np.testing.assert_array_equal(scene.positions, (row + np.arange(3) / 4) * (-1, -1, 1))
    np.testing.assert_allclose(np.exp(scene.log_scales), (row + 1) / 2.0 ** np.arange(3), rtol=1e-6)
    np.testing.assert_allclose(opacities(scene.opacity_logits), np.arange(4) / 3, atol=1e-7)
    w, x, y, z = unit_quaternions(4).T
    np.testing.assert_allclose(scene.rotations, np.stack([w, -x, -y, z], axis=1), atol=1e-7)
    colours = np.arange(3) / 64
    band = [[1, 0], [-1, 1], [1, 1.125], [-1, 1.25]]  # the coefficients of y and x are odd in a flipped axis
    expected = np.stack([sign * (row + value + colours) for sign, value in band], axis=1)
    np.testing.assert_allclose(scene.sh, expected, rtol=1e-6)


@pytest.mark.parametrize("kind", ["", "application/gltf-buffer", "application/octet-stream;charset=utf-8"])
def test_a_buffer_in_place_may_be_of_any_media_type(kind: str) -> None:
    data = EXAMPLES["gltf json"].replace(b"application/octet-stream", kind.encode())
    np.testing.assert_array_equal(read_scene(data).sh, read_scene(EXAMPLES["gltf json"]).sh)


def test_a_buffer_may_lie_beside_the_document(tmp_path: Path) -> None:
    document, data = gltf_document()
    document["buffers"][0]["uri"] = "data%20of/scene.bin"
    (tmp_path / "data of").mkdir()
    (tmp_path / "data of" / "scene.bin").write_bytes(data)
    (tmp_path / "scene.gltf").write_text(json.dumps(document))
    np.testing.assert_array_equal(read_scene(tmp_path / "scene.gltf").sh, read_scene(EXAMPLES["gltf glb"]).sh)
    refuses("input-incomplete", lambda: load((tmp_path / "scene.gltf").read_bytes()))


@pytest.mark.parametrize("uri", ["../a.bin", "/etc/passwd", "a/../../b", "http://example.org/a.bin", "%2e%2e/b", "", 7])
def test_a_buffer_elsewhere_is_refused(tmp_path: Path, uri: object) -> None:
    document, _ = gltf_document()
    document["buffers"][0]["uri"] = uri
    (tmp_path / "scene.gltf").write_text(json.dumps(document))
    refuses("input-corrupt", lambda: load(tmp_path / "scene.gltf"))


def test_interleaved_attributes() -> None:
    document, data = gltf_document(4, 0)
    arrays = []
    for view, entry in zip(document["bufferViews"], document["accessors"], strict=True):
        body = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        arrays.append(np.frombuffer(body, "<f4").reshape(4, -1))
        entry |= {"bufferView": 0, "byteOffset": 4 * sum(array.shape[1] for array in arrays[:-1])}
    rows = np.concatenate(arrays, axis=1)
    document["bufferViews"] = [{"buffer": 0, "byteLength": rows.nbytes, "byteStride": 4 * rows.shape[1]}]
    other, plain = read_scene(glb(document, rows.tobytes())), read_scene(glb(*gltf_document(4, 0)))
    for name, values in plain.arrays().items():
        np.testing.assert_array_equal(getattr(other, name), values)


def test_integers_are_scaled_where_they_are_normalised() -> None:
    """Signed ones so that the lowest two both are -1; 0 and 255 of an opacity half a step inside."""
    document, data = gltf_document(2, 0)
    for name, component, values in (
        (NAME("ROTATION"), 5122, np.array([[32767, 0, -32768, -32767], [0, 0, 0, 1]], "<i2")),
        (NAME("OPACITY"), 5121, np.array([0, 255], "<u1")),
        (NAME("SCALE"), 5123, np.array([[65535, 1, 0], [2, 3, 4]], "<u2")),
    ):
        view = document["bufferViews"][accessor(document, name)["bufferView"]]
        view |= {"byteOffset": len(data), "byteLength": values.nbytes}
        accessor(document, name).update(componentType=component, normalized=name != NAME("SCALE"))
        data += values.tobytes()
    document["buffers"][0]["byteLength"] = len(data)
    scene = read_scene(glb(document, data))
    np.testing.assert_allclose(scene.rotations[0], [-1, -1, 0, -1])
    np.testing.assert_allclose(opacities(scene.opacity_logits), [0.5 / 255, 254.5 / 255], rtol=1e-5)
    np.testing.assert_allclose(np.exp(scene.log_scales), [[65535, 1, 0], [2, 3, 4]], rtol=1e-5, atol=1e-40)
    assert np.isfinite(scene.log_scales).all()


def _covariances(scene: GaussianScene) -> np.ndarray:
    axes = matrix_from_quaternion(scene.rotations) * np.exp(scene.log_scales.astype(np.float64))[:, None, :]
    return np.asarray(axes @ axes.transpose(0, 2, 1))


TURN = matrix_from_quaternion(np.array([[0.3, -0.5, 0.7, 0.4]]))[0]
FLIP = np.diag([-1.0, -1.0, 1.0])


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (3.0, 3.0, 3.0), (0.5, 2.0, 7.0)])
@pytest.mark.parametrize("as_matrix", [False, True])
def test_nodes_move_turn_and_stretch(scale: tuple[float, float, float], as_matrix: bool) -> None:
    """Means by the matrix, covariances by both its sides, colours by its rotation, through two nodes."""
    linear, translation = TURN * scale, np.array([1.0, -2.0, 3.0])
    document, data = gltf_document(5, 3)
    q = np.array([0.3, -0.5, 0.7, 0.4]) / np.linalg.norm([0.3, -0.5, 0.7, 0.4])
    node: Document = {"rotation": [*q[1:], q[0]], "scale": list(scale), "translation": translation.tolist()}
    if as_matrix:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = linear, translation
        node = {"matrix": matrix.T.ravel().tolist()}
    document["nodes"] = [{"children": [1], "translation": [0, 0, 10]}, node | {"mesh": 0}]
    before, after = read_scene(glb(*gltf_document(5, 3))), read_scene(glb(document, data))
    whole = FLIP @ linear @ FLIP
    place = FLIP @ (translation + np.array([0.0, 0, 10]))
    np.testing.assert_allclose(after.positions, before.positions @ whole.T + place, atol=1e-9)
    np.testing.assert_allclose(_covariances(after), whole @ _covariances(before) @ whole.T, rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(after.opacity_logits, before.opacity_logits)
    directions = np.eye(3)
    turn = FLIP @ TURN @ FLIP
    seen = np.einsum("db,nbc->ndc", sh_basis(directions @ turn.T, 3), after.sh)
    np.testing.assert_allclose(seen, np.einsum("db,nbc->ndc", sh_basis(directions, 3), before.sh), rtol=1e-4, atol=1e-4)


def test_all_primitives_of_the_scene_make_one() -> None:
    """A mesh may stand in several places; lower degrees get zeros; what is no Gaussian is left out with a warning."""

    def several(document: Document) -> None:
        low = copy.deepcopy(primitive(document))
        for number in range(3):
            del low["attributes"][NAME(f"SH_DEGREE_1_COEF_{number}")]
        document["meshes"].append({"primitives": [low, {"attributes": {"POSITION": 0}}]})
        document["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 5]}, {"mesh": 1}, {"mesh": 0}]
        document["scenes"] = [{"nodes": [3]}, {"nodes": [0, 1, 2]}]
        document["scene"] = 1

    with pytest.warns(InputWarning, match="1 primitives without Gaussians"), pytest.warns(match="scenes are left out"):
        scene = read_scene(changed(several))
    one = read_scene(EXAMPLES["gltf glb"])
    np.testing.assert_array_equal(scene.positions[:4], one.positions)
    np.testing.assert_array_equal(scene.positions[4:8], one.positions + np.array([0, 0, 5]))
    assert len(scene) == 12
    assert not scene.sh[8:, 1:].any()


REFUSED: dict[str, tuple[Change, str]] = {
    "no Gaussians": (lambda d: primitive(d).pop("extensions"), "input-not-gaussians"),
    "an empty scene": (lambda d: d["scenes"][0].update(nodes=[]), "input-not-gaussians"),
    "another kernel": (lambda d: terms(d).update(kernel="box"), "input-gltf"),
    "colours of another space": (lambda d: terms(d).update(colorSpace="lin_p3"), "input-gltf"),
    "another compression": (lambda d: terms(d).update(extensions={"EXT_new_compression": {}}), "input-gltf"),
    "an extension required": (lambda d: d.update(extensionsRequired=["EXT_meshopt_compression"]), "input-gltf"),
    "compressed": (lambda d: accessor(d, "POSITION").pop("bufferView"), "input-gltf"),
    "sparse": (lambda d: accessor(d, "POSITION").update(sparse={}), "input-gltf"),
    "glTF 1": (lambda d: d["asset"].update(version="1.0"), "input-version"),
    "triangles": (lambda d: primitive(d).update(mode=4), "input-corrupt"),
    "no scale": (lambda d: primitive(d)["attributes"].pop(NAME("SCALE")), "input-gltf"),
    "half a degree": (lambda d: primitive(d)["attributes"].pop(NAME("SH_DEGREE_1_COEF_1")), "input-corrupt"),
    "a degree without that below": (
        lambda d: primitive(d)["attributes"].update({NAME(f"SH_DEGREE_3_COEF_{i}"): 0 for i in range(7)}),
        "input-corrupt",
    ),
    "different counts": (lambda d: accessor(d, NAME("SCALE")).update(count=3), "input-corrupt"),
    "more than there is": (lambda d: accessor(d, "POSITION").update(count=5), "input-corrupt"),
    "billions": (lambda d: accessor(d, "POSITION").update(count=2**40), "input-limit"),
    "a million": (lambda d: accessor(d, "POSITION").update(count=10**6), "input-limit"),
    "a view outside": (lambda d: d["bufferViews"][0].update(byteOffset=10**6), "input-corrupt"),
    "rows that overlap": (lambda d: d["bufferViews"][0].update(byteStride=4), "input-corrupt"),
    "a node in two places": (lambda d: d["scenes"][0].update(nodes=[0, 0]), "input-corrupt"),
    "a node within itself": (lambda d: d["nodes"][0].update(children=[0]), "input-corrupt"),
    "a node that mirrors": (lambda d: d["nodes"][0].update(scale=[1, 1, -1]), "input-gltf"),
    "a node that flattens": (lambda d: d["nodes"][0].update(scale=[1, 0, 1]), "input-gltf"),
    "a node that shears": (
        lambda d: d["nodes"][0].update(matrix=[1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
        "input-gltf",
    ),
    "a node that is repeated": (
        lambda d: d["nodes"][0].update(extensions={"EXT_mesh_gpu_instancing": {"attributes": {}}}),
        "input-gltf",
    ),
    "a node that may be hidden": (
        lambda d: d["nodes"][0].update(extensions={"KHR_node_visibility": {"visible": False}}),
        "input-gltf",
    ),
    "a matrix of text": (lambda d: d["nodes"][0].update(matrix="one"), "input-corrupt"),
    "a mesh that is not there": (lambda d: d["nodes"][0].update(mesh=7), "input-corrupt"),
    "a mesh in very many places, refused before it is read": (
        lambda d: d.update(nodes=[{"mesh": 0}] * 80_000, scenes=[{"nodes": list(range(80_000))}]),
        "input-limit",
    ),
    "true for a count": (lambda d: accessor(d, "POSITION").update(count=True), "input-corrupt"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals(name: str) -> None:
    change, refusal = REFUSED[name]
    refuses(refusal, lambda: load(changed(change)))


def add_degree_4(document: Document) -> None:
    attributes = primitive(document)["attributes"]
    for degree in (2, 3, 4):
        attributes.update({NAME(f"SH_DEGREE_{degree}_COEF_{i}"): attributes["POSITION"] for i in range(2 * degree + 1)})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["scenes"].append({"nodes": []}), "scenes are left out"),
        (lambda d: d.update(animations=[{"channels": [], "samplers": []}]), "animations are left out"),
        (add_degree_4, "degree 4 are left out"),
        (lambda d: primitive(d).update(indices=0), "indices of Gaussians is not read"),
        (lambda d: primitive(d).update(targets=[{"POSITION": 0}]), "targets of Gaussians is not read"),
        (lambda d: primitive(d)["attributes"].update(JOINTS_0=0, WEIGHTS_0=0), "JOINTS_0 of Gaussians is not read"),
    ],
)
def test_what_is_left_out_is_told(change: Change, said: str) -> None:
    with pytest.warns(InputWarning, match=said):
        assert len(read_scene(changed(change))) == 4


def test_an_extension_of_an_earlier_draft_is_named() -> None:
    def rename(document: Document) -> None:
        primitive(document)["extensions"] = {"KHR_spz_gaussian_splats_compression": {"bufferView": 0}}

    refuses("input-not-gaussians", lambda: load(changed(rename)), "KHR_spz_gaussian_splats_compression")


@pytest.mark.parametrize(("attribute", "value"), [("OPACITY", 1.5), ("OPACITY", -0.1), ("SCALE", -1.0)])
def test_values_outside_their_range_are_refused(attribute: str, value: float) -> None:
    document, data = gltf_document()
    at = document["bufferViews"][accessor(document, NAME(attribute))["bufferView"]]["byteOffset"]
    with pytest.raises(ScarError) as caught:
        load(glb(document, data[:at] + np.float32(value).tobytes() + data[at + 4 :]))
    assert (caught.value.refusal, caught.value.field) == ("input-corrupt", NAME(attribute))


def compressed(file: bytes, name: str = "KHR_gaussian_splatting_compression_spz_2", count: int = 7) -> bytes:
    """A .glb with an SPZ file in place of attributes, as Cesium writes it."""
    terms = {"extensions": {name: {"bufferView": 0}}}
    primitive = {"attributes": {"POSITION": 0}, "mode": 0, "extensions": {"KHR_gaussian_splatting": terms}}
    document = {
        "asset": {"version": "2.0"},
        "extensionsRequired": ["KHR_materials_unlit", "KHR_gaussian_splatting", name],
        "nodes": [{"mesh": 0, "translation": [1, 2, 3]}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [{"componentType": 5126, "count": count, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(file)}],
        "buffers": [{"byteLength": len(file)}],
    }
    return glb(document, file + bytes(-len(file) % 4))


@pytest.mark.parametrize("version", [2, 3, 4])
@pytest.mark.parametrize("name", ["KHR_gaussian_splatting_compression_spz_2", "KHR_gaussian_splatting_compression_spz"])
def test_an_spz_file_stands_for_all_attributes(version: int, name: str) -> None:
    """It is unpacked in the axes of glTF, where nodes place it."""
    scene, plain = read_scene(compressed(spz(version), name)), read_scene(spz(version))
    np.testing.assert_array_equal(scene.positions, plain.positions + np.array([-1, -2, 3]))
    np.testing.assert_array_equal(scene.sh, plain.sh)
    np.testing.assert_array_equal(scene.rotations, plain.rotations)
    refuses("input-corrupt", lambda: load(compressed(spz(version), name, count=8)))


def test_linear_colours_and_antialiasing_are_told() -> None:
    linear = changed(lambda d: terms(d).update(colorSpace="lin_rec709_display"))
    assert read_scene(linear).description.colour_space == ColourSpace.LINEAR
    antialiased = compressed(spz(4)[:14] + b"\x01" + spz(4)[15:])
    assert read_scene(antialiased).description.render_model == RenderModel.ANTIALIASED
