"""Small files of every input format, written by hand from their published layouts, and the values they hold."""

from __future__ import annotations

import base64
import gzip
import io
import json
import math
import struct
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from scarfmt.formats import load
from scarfmt.formats.export_ply import ply_header, ply_rows
from scarfmt.scene.gaussians import GaussianScene
from tests.formats import rad_files

HALF_SQRT = np.sqrt(0.5)


def read_scene(content: str | Path | bytes, *, format: str | None = None) -> GaussianScene:
    """The Gaussians of a file or its content."""
    scene = load(content, format=format)
    assert isinstance(scene, GaussianScene)
    return scene


def unit_quaternions(count: int, seed: int = 3) -> NDArray[np.float64]:
    """(count, 4) w, x, y, z, each with another largest component in turn, which is positive."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(count, 4)) * 0.3
    q[np.arange(count), np.arange(count) % 4] += 2.0
    unit: NDArray[np.float64] = q / np.linalg.norm(q, axis=1, keepdims=True)
    return unit


Properties = list[tuple[str, str]]


def ply(properties: Properties, rows: NDArray[np.float64], *, form: str = "little", extra: str = "") -> bytes:
    """A PLY of one vertex element; `form` is little, big or ascii."""
    names = {"little": "binary_little_endian", "big": "binary_big_endian", "ascii": "ascii"}
    lines = ["ply", f"format {names[form]} 1.0", "comment made for a test", f"element vertex {len(rows)}"]
    lines += [f"property {kind} {name}" for kind, name in properties]
    head = "\n".join([*lines, *extra.split("\n")] if extra else lines) + "\nend_header\n"
    if form == "ascii":
        return (head + "".join(" ".join(repr(float(v)) for v in row) + "\n" for row in rows)).encode()
    order = "<" if form == "little" else ">"
    kinds = {"float": "f4", "double": "f8", "uchar": "u1", "ushort": "u2", "int": "i4"}
    table = np.zeros(len(rows), [(name, order + kinds[kind]) for kind, name in properties])
    for column, (_, name) in enumerate(properties):
        table[name] = rows[:, column]
    return head.encode() + table.tobytes()


def inria_names(rest: int, scales: int = 3) -> list[str]:
    names = ["x", "y", "z", *(f"f_dc_{i}" for i in range(3)), *(f"f_rest_{i}" for i in range(rest)), "opacity"]
    return names + [f"scale_{i}" for i in range(scales)] + [f"rot_{i}" for i in range(4)]


def inria_ply(count: int = 5, rest: int = 45, *, kind: str = "float", form: str = "little", scales: int = 3) -> bytes:
    """An INRIA PLY in which the value in row r of the column number c is r + c / 64, exact in float32."""
    names = inria_names(rest, scales)
    rows = np.arange(count)[:, None] + np.arange(len(names))[None, :] / 64
    return ply([(kind, name) for name in names], rows, form=form)


def scene_ply(scene: GaussianScene, comments: Iterable[str] = ()) -> bytes:
    """A scene as INRIA's PLY, bit for bit but for positions."""
    return ply_header(len(scene), scene.sh.shape[1] - 1, comments) + ply_rows(scene).tobytes()


def compressed_ply(count: int = 300, *, colour_bounds: bool = True, rest: int = 0, chunks: int | None = None) -> bytes:
    """A PlayCanvas compressed PLY whose fields are simple functions of the row, see the test that reads it."""
    chunk_count = -(-count // 256) if chunks is None else chunks
    bounds = [f"{end}_{what}{axis}" for what in ("", "scale_") for end in ("min", "max") for axis in "xyz"]
    bounds += [f"{end}_{c}" for end in ("min", "max") for c in "rgb"] if colour_bounds else []
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {chunk_count}"]
    lines += [f"property float {name}" for name in bounds] + [f"element vertex {count}"]
    lines += [f"property uint packed_{name}" for name in ("position", "rotation", "scale", "color")]
    if rest:
        lines += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(rest))]
    one_chunk = [-1.0, -2.0, -3.0, 1.0, 2.0, 3.0, -8.0, -8.0, -8.0, -4.0, -4.0, -4.0]
    one_chunk += [-0.5, -0.5, -0.5, 1.5, 1.5, 1.5] if colour_bounds else []
    table = np.tile(np.array(one_chunk, "<f4"), (chunk_count, 1))
    table[1:, :6] += 10.0
    row = np.arange(count, dtype=np.uint32)
    position = (row % 2048) << 21 | (row % 1024) << 11 | (2047 - row % 2048)
    q = unit_quaternions(count)
    largest = np.abs(q).argmax(1)
    kept = np.array([np.delete(q[i], largest[i]) for i in range(count)]).reshape(-1, 3)
    fields = np.round((kept / (2 * HALF_SQRT) + 0.5) * 1023).astype(np.uint32)
    rotation = largest.astype(np.uint32) << 30 | fields[:, 0] << 20 | fields[:, 1] << 10 | fields[:, 2]
    colour = (row % 256) << 24 | np.uint32(128) << 16 | np.uint32(255) << 8 | (255 - row % 256)
    body = table.tobytes() + np.stack([position, rotation, position, colour], axis=1).astype("<u4").tobytes()
    sh = (np.arange(count * rest).reshape(count, rest) % 256).astype(np.uint8)
    return "\n".join([*lines, "end_header\n"]).encode() + body + sh.tobytes()


def splat(count: int = 4) -> bytes:
    rows = b""
    for i in range(count):
        rows += struct.pack("<6f", i, -i, 0.5, 1.0, math.e, 1 / math.e) + bytes([0, 255, 51, 255 * (i % 2)])
        rows += bytes([255, 128, 0, 64])
    return rows


def ksplat(degrees: tuple[int, ...] = (1,), level: int = 1) -> bytes:
    """A .ksplat with a section of 5 Gaussians for each degree, in a full bucket of 3 and one of 2; see its test."""
    position, real, harmonic = (("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1"))[level]
    row = np.arange(5)
    headers, bodies = b"", b""
    for degree in degrees:
        kinds = [("position", position, 3), ("scale", real, 3), ("rotation", real, 4), ("colour", "u1", 4)]
        rows = np.zeros(5, np.dtype([*kinds, ("sh", harmonic, (3 * ((degree + 1) ** 2 - 1),))]))
        rows["position"] = row[:, None] + np.arange(3) if level == 0 else 32767 + row[:, None]
        rows["scale"] = [0.5, 1.0, 2.0]
        rows["rotation"] = unit_quaternions(5)
        rows["colour"] = [0, 255, 51, 128]
        rows["sh"] = np.arange(rows["sh"].shape[1])
        buckets = b"" if level == 0 else struct.pack("<I6f", 2, 10, 20, 30, -10, -20, -30)
        lengths = (0, 0, 0.0, 0) if level == 0 else (3, 2, 5.0, 12)
        counts = (0, 0, 0, 0) if level == 0 else (32767, 0, 1, 1)
        headers += (struct.pack("<2I2IfH2x", 5, 5, *lengths) + struct.pack("<4IH", *counts, degree)).ljust(1024, b"\0")
        bodies += buckets + rows.tobytes()
    count, total = len(degrees), 5 * len(degrees)
    head = struct.pack("<4B4IH2x3f2f", 0, 1, 0, 0, count, count, total, total, level, 0, 0, 0, -1, 3)
    return head.ljust(4096, b"\0") + headers + bodies


def spz(version: int, count: int = 7, degree: int = 1, *, extension: bytes = b"", trailing: bytes = b"") -> bytes:
    """An SPZ of any version; position of row i is (i, -i, i/2), see the test for the rest."""
    row = np.arange(count)
    coordinates = np.stack([row, -row, row / 2], axis=1)
    if version == 1:
        positions = coordinates.astype("<f2").tobytes()
    else:
        fixed = np.round(coordinates * 4096).astype(np.int64) & 0xFFFFFF
        positions = b"".join(int(v).to_bytes(3, "little") for v in fixed.ravel())
    alphas = (row * 40 % 256).astype(np.uint8).tobytes()
    colours = np.tile(np.array([0, 128, 255], np.uint8), (count, 1)).tobytes()
    scales = np.tile(np.array([0, 160, 255], np.uint8), (count, 1)).tobytes()
    xyzw = unit_quaternions(count)[:, [1, 2, 3, 0]]
    if version < 3:
        xyzw *= np.sign(xyzw[:, 3:])
        rotations = np.round(xyzw[:, :3] * 127.5 + 127.5).astype(np.uint8).tobytes()
    else:
        rotations = b"".join(_smallest_three(q).to_bytes(4, "little") for q in xyzw)
    harmonics = (np.arange(count * 3 * ((degree + 1) ** 2 - 1)) % 256).astype(np.uint8).tobytes()
    streams = [positions, alphas, colours, scales, rotations] + ([harmonics] if degree else [])
    flags = 2 if extension else 0
    if version < 4:
        head = struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, 12, flags, 0)
        return gzip.compress(head + b"".join(streams) + extension) + trailing
    packed = [zstandard.ZstdCompressor().compress(stream) for stream in streams]
    head = struct.pack("<4sIIBBBBI12x", b"NGSP", 4, count, degree, 12, flags, len(packed), 32 + len(extension))
    table = b"".join(struct.pack("<QQ", len(p), len(s)) for p, s in zip(packed, streams, strict=True))
    return head + extension + table + b"".join(packed) + trailing


def _smallest_three(xyzw: NDArray[np.float64]) -> int:
    largest = int(np.abs(xyzw).argmax())
    word = largest
    for i in range(4):
        if i != largest:
            component = xyzw[i] * np.sign(xyzw[largest])
            word = word << 10 | int(component < 0) << 9 | round(abs(component) / HALF_SQRT * 511)
    return word


def webp(pixels: NDArray[np.uint8]) -> bytes:
    out = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(out, "WEBP", lossless=True, exact=True)
    return out.getvalue()


def sog_files(count: int = 6, *, version: int = 2, bands: int = 1, width: int = 4) -> dict[str, bytes]:
    """The files of a SOG, images `width` pixels wide with spare pixels at the end."""
    height = -(-count // width) + 1
    row = np.arange(count)

    def image(*channels: Any) -> bytes:
        pixels = np.zeros((height * width, 4), np.uint8)
        pixels[:count] = np.stack(np.broadcast_arrays(*channels), axis=-1)
        return webp(pixels.reshape(height, width, 4))

    q = unit_quaternions(count)
    largest = np.abs(q).argmax(1)
    kept = np.array([np.delete(q[i], largest[i]) for i in range(count)]).reshape(-1, 3)
    quats = np.round((kept / (2 * HALF_SQRT) + 0.5) * 255)
    coefficients = (bands + 1) ** 2 - 1
    palette = np.zeros((1, 64, coefficients, 4), np.uint8)
    palette[0, :, :, 0] = np.arange(64)[:, None]
    palette[0, :, :, 1] = np.arange(coefficients)[None, :]
    palette[..., 3] = 255
    codebook = [i / 8 - 4 for i in range(256)]
    meta: dict[str, Any] = {
        "means": {"mins": [-1, -1, -1], "maxs": [1, 2, 3], "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": codebook, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": codebook, "files": ["sh0.webp"]},
    }
    if bands:
        meta["shN"] = {"codebook": codebook, "count": 64, "bands": bands}
        meta["shN"]["files"] = ["shN_centroids.webp", "shN_labels.webp"]
    if version == 2:
        meta |= {"version": 2, "count": count}
    else:
        meta["means"]["shape"] = [count, 3]
        meta["scales"] |= {"mins": [-9, -9, -9], "maxs": [0, 0, 0]}
        meta["sh0"] |= {"mins": [-1, -1, -1, -5], "maxs": [1, 1, 1, 5]}
        for key in {"scales", "sh0", "shN"} & meta.keys():
            del meta[key]["codebook"]
        if bands:
            meta["shN"] = {"mins": -1.0, "maxs": 1.0, "files": meta["shN"]["files"]}
    files = {
        "meta.json": json.dumps(meta).encode(),
        "means_l.webp": image(row, 255, 0, 255),
        "means_u.webp": image(0, 255, 128, 255),
        "quats.webp": image(quats[:, 0], quats[:, 1], quats[:, 2], largest + 252),
        "scales.webp": image(row, 16, 32, 255),
        "sh0.webp": image(32, 40, row, 255 - row),
    }
    if bands:
        files["shN_centroids.webp"] = webp(palette.reshape(1, -1, 4))
        files["shN_labels.webp"] = image(63 - row, 0, 0, 255)
    return files


def zipped(files: dict[str, bytes], method: int = zipfile.ZIP_STORED, prefix: str = "") -> bytes:
    """An archive, the same whenever it is made."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(prefix + name), data, method)
    return out.getvalue()


def npy(array: NDArray[Any]) -> bytes:
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def anchor_arrays(count: int = 5, slots: int = 2, width: int = 3, extra: int = 4) -> dict[str, NDArray[Any]]:
    """The arrays of an anchor model whose networks take `extra` inputs beside the features."""
    rng = np.random.default_rng(5)
    shapes: dict[str, tuple[int, ...]] = {
        "anchor": (count, 3),
        "feat": (count, width),
        "offset": (count, slots, 3),
        "scaling": (count, 6),
    }
    for name, outputs in (("opacity", slots), ("cov", 7 * slots), ("color", 3 * slots)):
        shapes[f"mlp_{name}.0.weight"], shapes[f"mlp_{name}.0.bias"] = (4, width + extra), (4,)
        shapes[f"mlp_{name}.2.weight"], shapes[f"mlp_{name}.2.bias"] = (outputs, 4), (outputs,)
    return {name: rng.normal(size=shape).astype(np.float32) for name, shape in shapes.items()}


def anchor_npz(arrays: dict[str, NDArray[Any]] | None = None) -> bytes:
    arrays = anchor_arrays() if arrays is None else arrays
    return zipped({f"{name}.npy": npy(array) for name, array in arrays.items()}, zipfile.ZIP_DEFLATED)


def gltf_document(count: int = 4, degree: int = 1) -> tuple[dict[str, Any], bytes]:
    """A glTF of `count` Gaussians and its buffer: number c of row r of the attribute number a is simple, see below."""
    name = "KHR_gaussian_splatting:{}".format
    row = np.arange(count)[:, None]
    xyzw = unit_quaternions(count)[:, [1, 2, 3, 0]]
    arrays = {
        "POSITION": ("VEC3", row + np.arange(3) / 4),
        name("ROTATION"): ("VEC4", xyzw),
        name("SCALE"): ("VEC3", (row + 1) / 2.0 ** np.arange(3)),
        name("OPACITY"): ("SCALAR", row / max(count - 1, 1)),
    }
    for band in range(degree + 1):
        for number in range(2 * band + 1):
            arrays[name(f"SH_DEGREE_{band}_COEF_{number}")] = ("VEC3", row + band + number / 8 + np.arange(3) / 64)
    views: list[dict[str, Any]] = []
    data, accessors, attributes = b"", [], {}
    for attribute, (kind, values) in arrays.items():
        attributes[attribute] = len(views)
        accessors.append({"bufferView": len(views), "componentType": 5126, "count": count, "type": kind})
        body = values.astype("<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(body)})
        data += body
    extension = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    primitive = {"attributes": attributes, "mode": 0, "extensions": {"KHR_gaussian_splatting": extension}}
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_gaussian_splatting"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    return document, data


def glb(document: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf(document: dict[str, Any], data: bytes) -> bytes:
    """A .gltf with its buffer in place."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return json.dumps(document | {"buffers": [{"byteLength": len(data), "uri": uri}]}).encode()


EXAMPLES: dict[str, bytes] = {
    "ply": inria_ply(3, 9),
    "ply ascii": inria_ply(3, 0, form="ascii"),
    "compressed-ply": compressed_ply(3, rest=9),
    "spz v2": spz(2),
    "spz v3": spz(3),
    "spz v4": spz(4),
    "sog": zipped(sog_files()),
    "anchor-npz": anchor_npz(),
    "ksplat": ksplat(),
    "rad": rad_files.small(),
    "splat": splat(),
    "gltf glb": glb(*gltf_document()),
    "gltf json": gltf(*gltf_document(2, 0)),
}
"""A small valid file of every format, by format id and variant."""


def odd_scene(seed: int, count: int, degree: int, *, reach: float = 1e4) -> GaussianScene:
    """A scene of `count` Gaussians, an eighth of which are odd in each attribute.

    Args:
        seed: of its numbers.
        count: of its Gaussians.
        degree: of its spherical harmonics.
        reach: where outliers lie.
    """
    rng = np.random.default_rng(seed)

    def some() -> np.ndarray:
        return rng.random(count) < 1 / 8

    positions = rng.normal(size=(count, 3))
    positions[some()] *= reach / 4
    log_scales = rng.uniform(-12, 5, (count, 3))
    log_scales[some(), 2] = -400.0  # a size of zero
    rotations = rng.normal(size=(count, 4)) * 10.0 ** rng.uniform(-30, 15, (count, 1))
    rotations[some()] = 0.0
    logits = rng.normal(size=count) * 4
    logits[some()] = 400.0
    logits[some()] = -400.0
    sh = rng.normal(size=(count, (degree + 1) ** 2, 3)) * 0.4
    sh[some()] *= 12
    return GaussianScene(
        np.clip(positions, -reach, reach).astype(np.float32).astype(np.float64),
        log_scales.astype(np.float32),
        rotations.astype(np.float32),
        logits.astype(np.float32),
        sh.astype(np.float32),
    )


odd_scenes = st.builds(odd_scene, st.integers(0, 2**32), st.integers(1, 600), st.integers(0, 3))
"""Scenes of less than a chunk of a compressed PLY to more than two."""
