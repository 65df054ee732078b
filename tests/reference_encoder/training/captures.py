"""Tiny captures: eight photos of a few Gaussians, written as each program writes captures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from scarfmt.arrays import F64, U8
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.images import to_bytes
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from tests.formats import scene_files
from tests.render.capture import files

PHOTOS = 8
WIDTH, HEIGHT = 48, 36


@cache
def scene() -> GaussianScene:
    """Sixty coloured blobs in a ball of one unit."""
    random = np.random.default_rng(1)
    count = 60
    return GaussianScene(
        random.normal(size=(count, 3)) * 0.4,
        random.normal(-1.8, 0.3, (count, 3)).astype(np.float32),
        random.normal(size=(count, 4)).astype(np.float32),
        random.normal(2.0, 1.0, count).astype(np.float32),
        random.normal(0.0, 1.0, (count, 1, 3)).astype(np.float32),
    )


@cache
def cameras(width: int = WIDTH, height: int = HEIGHT, count: int = PHOTOS) -> tuple[Camera, ...]:
    """A ring round the blobs."""
    orbit = orbit_cameras(scene(), count, width, height)
    return tuple(replace(camera, name=f"photo{index}.png", near=0.2) for index, camera in enumerate(orbit))


def photo(camera: Camera) -> U8:
    """(height, width, 3) uint8: what `camera` sees."""
    return to_bytes(render(scene(), camera))


def write_photos(views: Sequence[Camera], folder: Path) -> None:
    for camera in views:
        path = folder / camera.name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(photo(camera)).save(path)


def ply(positions: F64, colours: U8 | None) -> bytes:
    """A point cloud as structure from motion leaves it."""
    properties, rows = [("float", axis) for axis in "xyz"], positions
    if colours is not None:
        properties += [("uchar", name) for name in ("red", "green", "blue")]
        rows = np.concatenate([positions, colours], axis=1)
    return scene_files.ply(properties, rows)


def points() -> tuple[F64, U8]:
    """The places of the blobs, in binary32, and a colour for each."""
    positions = scene().positions.astype(np.float32).astype(np.float64)
    return positions, np.arange(3 * len(positions), dtype=np.uint8).reshape(-1, 3)


def own(folder: Path, views: Sequence[Camera] | None = None) -> Path:
    """The capture in this project's form: cameras.json, points3d.ply, images/."""
    chosen = cameras() if views is None else views
    write_photos(chosen, folder / "images")
    (folder / "cameras.json").write_text(json.dumps(files.own(chosen)))
    (folder / "points3d.ply").write_bytes(ply(*points()))
    return folder


def colmap(folder: Path, form: str) -> Path:
    """COLMAP's: images/ and sparse/0, as ``"bin"`` or ``"txt"``."""
    write_photos(cameras(), folder / "images")
    model = folder / "sparse" / "0"
    positions, colours = points()
    if form == "bin":
        files.colmap_binary(cameras(), model)
        (model / "points3D.bin").write_bytes(files.colmap_points_binary(positions, colours))
    else:
        files.colmap_text(cameras(), model)
        (model / "points3D.txt").write_text(files.colmap_points_text(positions, colours))
    return folder


def nerfstudio(folder: Path) -> Path:
    """transforms.json with photos in images/ and a PLY that it names."""
    views = [replace(camera, name=f"images/{camera.name}") for camera in cameras()]
    write_photos(views, folder)
    (folder / "transforms.json").write_text(json.dumps(files.transforms(views) | {"ply_file_path": "sparse_pc.ply"}))
    (folder / "sparse_pc.ply").write_bytes(ply(*points()))
    return folder


def blender(folder: Path) -> Path:
    """NeRF's synthetic scenes: a file for each split, names without an ending, transparent photos."""
    for split, chosen in (("train", cameras()[1:]), ("test", cameras()[:1])):
        frames = []
        for camera in chosen:
            name = f"./{split}/{camera.name.removesuffix('.png')}"
            (folder / split).mkdir(parents=True, exist_ok=True)
            seen = photo(camera)
            alpha = np.full((*seen.shape[:2], 1), 255, np.uint8)
            alpha[0, 0], seen[0, 0] = 0, 200
            Image.fromarray(np.concatenate([seen, alpha], axis=2)).save(folder / f"{name}.png")
            frames.append({"file_path": name, "transform_matrix": files.opengl_pose(camera).tolist()})
        angle = 2 * np.arctan(chosen[0].width / 2 / chosen[0].fx)
        document = {"camera_angle_x": float(angle), "frames": frames}
        (folder / f"transforms_{split}.json").write_text(json.dumps(document))
    return folder
