"""Cameras written as each program writes them."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scarfmt.arrays import F64, U8
from scarfmt.render.camera import Camera
from scarfmt.scene.rotation import quaternion_from_matrix


def camera(seed: int, split: str = "") -> Camera:
    """A camera with everything random but its principal point, which is the middle: one format has no other."""
    draw = np.random.default_rng(seed)
    width, height = (int(v) for v in draw.integers(2, 4000, 2))
    pose = np.eye(4)
    rotation, _ = np.linalg.qr(draw.normal(size=(3, 3)))
    pose[:3, :3] = rotation * np.linalg.det(rotation)
    pose[:3, 3] = draw.normal(size=3) * 10
    focal = draw.uniform(1, 5000, 2)
    return Camera(width, height, *focal.tolist(), width / 2, height / 2, pose, f"photo {seed:04}.jpg", split)


def own(cameras: Sequence[Camera]) -> dict[str, Any]:
    """The camera list in this project's form."""
    keys = {"name": "name", "W": "width", "H": "height", "fx": "fx", "fy": "fy", "cx": "cx", "cy": "cy"}
    entries = [{key: getattr(c, name) for key, name in keys.items()} for c in cameras]
    poses = [{"world_to_camera": c.world_to_camera.tolist(), "split": c.split} for c in cameras]
    return {"images": [entry | pose for entry, pose in zip(entries, poses, strict=True)]}


def inria(cameras: Sequence[Camera]) -> list[dict[str, Any]]:
    """The camera list that INRIA's trainer leaves beside a scene."""
    return [
        {
            "id": index,
            "img_name": c.name,
            "width": c.width,
            "height": c.height,
            "position": c.centre.tolist(),
            "rotation": c.world_to_camera[:3, :3].T.tolist(),
            "fx": c.fx,
            "fy": c.fy,
        }
        for index, c in enumerate(cameras)
    ]


def opengl_pose(c: Camera) -> F64:
    """(4, 4) camera to world, y up, z backwards."""
    pose = np.linalg.inv(c.world_to_camera)
    pose[:3, 1:3] *= -1
    return pose


def transforms(cameras: Sequence[Camera]) -> dict[str, Any]:
    """Nerfstudio's, intrinsics in each frame."""
    frames = [
        {
            "file_path": c.name,
            "transform_matrix": opengl_pose(c).tolist(),
            "w": c.width,
            "h": c.height,
            "fl_x": c.fx,
            "fl_y": c.fy,
            "cx": c.cx,
            "cy": c.cy,
        }
        for c in cameras
    ]
    tests = [c.name for c in cameras if c.split == "test"]
    return {"camera_model": "OPENCV", "frames": frames, "test_filenames": tests}


def colmap_binary(cameras: Sequence[Camera], folder: Path) -> Path:
    """A sparse model: a lens of its own for each image, three keypoints in each."""
    folder.mkdir(parents=True, exist_ok=True)
    lenses = [struct.pack("<iiQQ4d", i, 1, c.width, c.height, c.fx, c.fy, c.cx, c.cy) for i, c in enumerate(cameras)]
    images = [
        struct.pack("<I7dI", 7 + i, *_quaternion(c), *c.world_to_camera[:3, 3], i)
        + c.name.encode()
        + b"\0"
        + struct.pack("<Q", 3)
        + bytes(72)
        for i, c in enumerate(cameras)
    ]
    count = struct.pack("<Q", len(cameras))
    (folder / "cameras.bin").write_bytes(count + b"".join(lenses))
    (folder / "images.bin").write_bytes(count + b"".join(images))
    return folder


def colmap_text(cameras: Sequence[Camera], folder: Path) -> Path:
    """The COLMAP model as text; with lists of keypoints longer than any other line, or none."""
    folder.mkdir(parents=True, exist_ok=True)
    lenses = [f"{i} PINHOLE {c.width} {c.height} {_numbers((c.fx, c.fy, c.cx, c.cy))}" for i, c in enumerate(cameras)]
    images = [
        f"{7 + i} {_numbers(_quaternion(c))} {_numbers(c.world_to_camera[:3, 3])} {i} {c.name}\n"
        + "1.5 2.5 -1 " * (20000 * (i % 2))
        for i, c in enumerate(cameras)
    ]
    (folder / "cameras.txt").write_text("\n".join(["# Camera list", *lenses, ""]))
    (folder / "images.txt").write_text("\n".join(["# Image list", *images, ""]))
    return folder


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _quaternion(c: Camera) -> F64:
    return quaternion_from_matrix(c.world_to_camera[None, :3, :3])[0]


def in_json(content: object, path: Path) -> Path:
    """`content` in a file, NaN and infinity as Python's json writes them."""
    path.write_text(json.dumps(content))
    return path


def colmap_points_binary(positions: F64, colours: U8) -> bytes:
    """`points3D.bin`: tracks of different lengths."""
    rows = [
        struct.pack("<Q3d3BdQ", 5 + i, *position, *colour, 0.5, i % 4) + bytes(8 * (i % 4))
        for i, (position, colour) in enumerate(zip(positions.tolist(), colours.tolist(), strict=True))
    ]
    return struct.pack("<Q", len(positions)) + b"".join(rows)


def colmap_points_text(positions: F64, colours: U8) -> str:
    """`points3D.txt`."""
    rows = [
        f"{5 + i} {_numbers(position)} {' '.join(map(str, colour))} 0.5 " + "1 2 " * (i % 4)
        for i, (position, colour) in enumerate(zip(positions.tolist(), colours.tolist(), strict=True))
    ]
    return "\n".join(["# 3D point list", *rows, ""])
