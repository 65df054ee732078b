"""Poses for photos that have none, and photos of distorting lenses made anew as a pinhole camera would take them.

COLMAP does both, as pycolmap (extra ``poses``), in a process of its own, which
:mod:`reference_encoder.training.colmap_process` is: Pillow has aborted while writing PNGs in processes that had
imported pycolmap.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import secrets
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np
from PIL import Image

from reference_encoder.training.photo_files import size_of, upright_photos, wrong_capture
from scarfmt.arrays import F64
from scarfmt.coding.writer import Report
from scarfmt.errors import InvalidInput
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras, load_points
from scarfmt.render.capture.record import Distorted
from scarfmt.scene.rotation import quaternion_from_matrix

UNDISTORTED = "undistorted"
INPUT, MODEL, PAIRS = "input", "model", "pairs.txt"
_UPRIGHT = "upright"
_LIST = "cameras.json"
_SOURCE = "source.txt"
_MAKING = 4
"""How photos are made: one more whenever that changes, so that none are kept that were made otherwise."""
_THUMBNAIL = (24, 16)
_ALIKE = 10
"""Photos that each is matched with because they look alike, beside its neighbours by name: they close loops."""
_LEAST_PART = 0.5
"""Least share of the photos whose poses must be found. With fewer, most of the scene would be missing."""

Made = list[tuple[Camera, Path]]
"""Cameras and the photos that were made for them."""


def undistort_photos(
    path: Path, views: Sequence[Distorted], files: Sequence[Path], workspace: Path | None, report: Report
) -> Made:
    """The photos as pinhole cameras would have taken them, with these cameras.

    Args:
        path: of the capture, for messages.
        views: the photos' lenses and poses.
        workspace: folder for what is made, which is made once.
        report: called with (stage, part done).

    Raises:
        InvalidInput: ``input-dependency``, ``input-capture``; ``input-options``: there is no workspace.
    """
    place = workplace(path, "its lenses distort; to undistort the photos", workspace)

    def make(folder: Path) -> None:
        names = _stage(folder, files, [""] * len(files))
        _write_model(folder / MODEL, views, names)
        _run("undistort", folder, path, report)
        _tidy(folder)

    folder, made = make_once(place, UNDISTORTED, describe_files(files, repr(views)), make), []
    for camera in load_cameras(folder):
        view = views[_number(camera)]
        made.append((replace(camera, name=view.name, split=view.split), folder / "images" / camera.name))
    return made


def pose_photos(path: Path, files: Sequence[Path], workspace: Path | None, report: Report) -> tuple[Made, F64]:
    """The photos with their poses, as pinhole cameras would have taken them, and points on what they show.

    Arguments and errors are those of :func:`undistort_photos`; photos whose pose is not found are left out.
    """
    place = workplace(path, "there are photos but no poses; to find these", workspace)

    def make(folder: Path) -> None:
        upright = upright_photos(files, folder / _UPRIGHT)
        sizes = [size_of(file) for file in upright]
        kinds = sorted(set(sizes))
        # A lens of its own for every size, which is a folder to COLMAP.
        names = _stage(folder, upright, [f"{kinds.index(size)}/" for size in sizes])
        (folder / PAIRS).write_text(_pairs_alike(upright, names))
        _run("poses", folder, path, report)
        cameras = load_cameras(folder)
        if len(cameras) < max(2, _LEAST_PART * len(files)):
            message = f"poses were found for {len(cameras)} of {len(files)} photos only"
            raise wrong_capture(path, f"{message}; more photos have to overlap more")
        _name_as_given(folder, cameras, files)
        _tidy(folder)

    folder = make_once(place, UNDISTORTED, describe_files(files, "poses"), make)
    points = load_points(folder / "sparse")
    assert points is not None
    return [(camera, folder / "images" / camera.name) for camera in load_cameras(folder)], points


def _name_as_given(folder: Path, cameras: Sequence[Camera], files: Sequence[Path]) -> None:
    """Give new photos the names of those they were made from, and list them: `compare --photos` goes by names."""
    numbered = (folder / "images").rename(folder / "numbered")
    (folder / "images").mkdir()
    entries = []
    for camera in cameras:
        name = files[_number(camera)].name
        os.replace(numbered / camera.name, folder / "images" / name)
        lens = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy}
        pose = {"world_to_camera": camera.world_to_camera.tolist()}
        entries.append({"name": name, "W": camera.width, "H": camera.height} | lens | pose)
    (folder / _LIST).write_text(json.dumps({"images": entries}))


def workplace(
    path: Path, purpose: str, workspace: Path | None, package: str = "pycolmap", extra: str = "poses"
) -> Path:
    """The workspace, once there is one and the package of an extra; the purpose is told where something is missing."""
    if importlib.util.find_spec(package) is None:
        raise InvalidInput("input-dependency", f"{path}: {purpose}: pip install 'scarfmt[{extra}]'")
    if workspace is None:
        message = f"{path}: {purpose}, give a workspace to put new photos into"
        raise InvalidInput("input-options", message, field="workspace")
    return workspace


def make_once(workspace: Path, name: str, source: str, make: Callable[[Path], None]) -> Path:
    """The folder that `make` fills, whole or not at all; one that is there from the same source is taken as it is."""
    target = workspace / name
    if (target / _SOURCE).is_file() and (target / _SOURCE).read_text() == source:
        return target
    new = not workspace.exists()
    workspace.mkdir(parents=True, exist_ok=True)
    for killed in workspace.glob(f".{name}.*.part"):
        shutil.rmtree(killed, ignore_errors=True)
    temporary = workspace / f".{name}.{secrets.token_hex(6)}.part"
    try:
        temporary.mkdir()
        make(temporary)
        (temporary / _SOURCE).write_text(source)
        shutil.rmtree(target, ignore_errors=True)
        os.replace(temporary, target)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        if new:
            with suppress(OSError):
                workspace.rmdir()
        raise
    return target


def _tidy(folder: Path) -> None:
    """Leave only what is read again: COLMAP puts more there."""
    for path in folder.iterdir():
        if path.is_dir() and path.name not in ("images", "sparse"):
            shutil.rmtree(path)
        elif not path.is_dir() and path.name != _LIST:
            path.unlink()


def describe_files(files: Sequence[Path], more: str) -> str:
    """A text that changes with the photos, or with what else goes in.

    Dates are left out: poses that are found again differ a little, and a training goes on with the same ones only. So
    photos copied to another machine, without their dates, keep the poses that came with them.
    """
    stated = []
    for file in files:
        with file.open("rb") as stream:
            stated.append((file.name, hashlib.file_digest(stream, "sha256").hexdigest()))
    return hashlib.sha256(f"{_MAKING} {stated} {more}".encode()).hexdigest()


def _stage(folder: Path, files: Sequence[Path], prefixes: Sequence[str]) -> list[str]:
    """Put the photos into `folder`'s input under names that are only numbers, and return these: no name leads away."""
    names = []
    for number, (file, prefix) in enumerate(zip(files, prefixes, strict=True)):
        name = f"{prefix}{number:06}{file.suffix.lower()}"
        target = folder / INPUT / name
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            target.symlink_to(file.absolute())
        except OSError:  # systems and disks without links
            shutil.copyfile(file, target)
        names.append(name)
    return names


def _number(camera: Camera) -> int:
    """The number of a photo among those given, from its staged name."""
    return int(Path(camera.name).stem)


def _write_model(folder: Path, views: Sequence[Distorted], names: Sequence[str]) -> None:
    """COLMAP's text files, a lens for each photo, and no points."""
    folder.mkdir(parents=True)
    lenses, images = [], []
    for number, (view, name) in enumerate(zip(views, names, strict=True), 1):
        lenses.append(f"{number} {view.model} {view.width} {view.height} {_words(np.array(view.parameters))}\n")
        rotation = quaternion_from_matrix(view.world_to_camera[None, :3, :3])[0]
        images.append(f"{number} {_words(rotation)} {_words(view.world_to_camera[:3, 3])} {number} {name}\n\n")
    (folder / "cameras.txt").write_text("".join(lenses))
    (folder / "images.txt").write_text("".join(images))
    (folder / "points3D.txt").write_text("")


def _words(values: F64) -> str:
    return " ".join(repr(float(value)) for value in values)


def _pairs_alike(files: Sequence[Path], names: Sequence[str]) -> str:
    """COLMAP's list of pairs: each photo with those whose thumbnails correlate most with its own."""
    thumbnails = []
    for file in files:
        with Image.open(file) as image:
            image.draft("L", (8 * _THUMBNAIL[0], 8 * _THUMBNAIL[1]))
            grey = np.asarray(image.convert("L").resize(_THUMBNAIL, Image.Resampling.BOX), np.float64).ravel()
        grey -= grey.mean()
        thumbnails.append(grey / (np.linalg.norm(grey) or 1.0))
    table = np.array(thumbnails)
    likeness = table @ table.T
    np.fill_diagonal(likeness, -2.0)
    nearest = np.argsort(-likeness, axis=1, kind="stable")[:, : min(_ALIKE, len(files) - 1)]
    pairs = {(min(one, int(other)), max(one, int(other))) for one in range(len(files)) for other in nearest[one]}
    return "".join(f"{names[one]} {names[other]}\n" for one, other in sorted(pairs))


def _run(action: str, folder: Path, path: Path, report: Report) -> None:
    """Run COLMAP's process to its end; it is ended with this one's work."""
    command = [sys.executable, "-m", "reference_encoder.training.colmap_process", action, str(folder)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with tempfile.TemporaryFile("w+") as errors:
        # A session of its own: Ctrl-C reaches this process alone, which ends that one.
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment, start_new_session=True
        ) as process:
            assert process.stdout is not None
            try:
                for line in process.stdout:
                    if line.startswith("{"):
                        progress = json.loads(line)
                        report(progress["stage"], progress["part"])
                process.wait()
            finally:
                process.kill()
        if process.returncode != 0:
            raise wrong_capture(path, f"COLMAP failed: {_last_line(errors)}")


def _last_line(errors: IO[str]) -> str:
    errors.seek(0)
    lines = [line.strip() for line in errors if line.strip()]
    return lines[-1][:300] if lines else "it said nothing"
