"""COLMAP's sparse models: `cameras` and `images`, binary or text, as its "Output Format" page defines them.

Poses are from world to camera, with OpenCV axes: those of :class:`Camera`. Lens distortion is ignored with a warning:
undistortion leaves about the same pinhole. Fisheye lenses are refused. Keypoints are skipped unread. Where both forms
are there, the binary one is read, as COLMAP does.
"""

from __future__ import annotations

import math
import struct
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from scarfmt.arrays import F64
from scarfmt.errors import InputWarning, InvalidInput, plural
from scarfmt.render.camera import Camera
from scarfmt.render.capture.record import EXPORT_AGAIN, MAX_CAMERAS, Distorted, Record, how_to_draw, wrong
from scarfmt.scene.rotation import matrix_from_quaternion

FOLDERS = (".", "sparse", "sparse/0", "0", "colmap/sparse/0")
"""Where a model lies: COLMAP's, below a `sparse` that is given, and Nerfstudio's."""
MAX_NAME = 4096
_MAX_LINE = 1 << 16
"""Bytes of a line that is read; lines of keypoints are longer, and skipped."""
_KEYPOINT = 24


@dataclass(frozen=True)
class LensModel:
    """A camera model of COLMAP.

    Attributes:
        name: in text files.
        parameters: how many numbers it has: one or two focal lengths, the principal point, then distortion.
        focal_lengths: 1 or 2; 0 where no pinhole is near it.
    """

    name: str
    parameters: int
    focal_lengths: int


MODELS = (
    LensModel("SIMPLE_PINHOLE", 3, 1),
    LensModel("PINHOLE", 4, 2),
    LensModel("SIMPLE_RADIAL", 4, 1),
    LensModel("RADIAL", 5, 1),
    LensModel("OPENCV", 8, 2),
    LensModel("OPENCV_FISHEYE", 8, 0),
    LensModel("FULL_OPENCV", 12, 2),
    LensModel("FOV", 5, 0),
    LensModel("SIMPLE_RADIAL_FISHEYE", 4, 0),
    LensModel("RADIAL_FISHEYE", 5, 0),
    LensModel("THIN_PRISM_FISHEYE", 12, 0),
    LensModel("RAD_TAN_THIN_PRISM_FISHEYE", 16, 0),
    LensModel("SIMPLE_DIVISION", 4, 0),
    LensModel("DIVISION", 5, 0),
    LensModel("SIMPLE_FISHEYE", 3, 0),
    LensModel("FISHEYE", 4, 0),
    LensModel("EUCM", 6, 0),
    LensModel("EQUIRECTANGULAR", 2, 0),
)
"""By the number that binary files have for them."""


@dataclass(frozen=True)
class Lens:
    """Intrinsics of one camera, as the file has them; `record` is where they stand.

    Attributes:
        record: for faults.
        model: of COLMAP.
        size: width and height, pixels.
        parameters: of the model.
    """

    record: Record
    model: LensModel
    size: tuple[int, int]
    parameters: tuple[float, ...]

    @property
    def distorts(self) -> bool:
        """Whether it is no pinhole."""
        pinhole = self.model.focal_lengths + 2
        return self.model.focal_lengths == 0 or any(value != 0 for value in self.parameters[pinhole:])

    def pinhole(self) -> tuple[tuple[int, int], tuple[float, float], tuple[float, float]]:
        """Size, focal lengths and principal point, pixels, distortion left out.

        Raises:
            InvalidInput: ``input-cameras``: a fisheye lens, or a value out of range.
        """
        if self.model.focal_lengths == 0:
            advice = "run 'colmap image_undistorter', and give its folder"
            raise self.record.fault("model", how_to_draw(self.model.name, advice))
        names = [*(("f",) if self.model.focal_lengths == 1 else ("fx", "fy")), "cx", "cy"]
        values = {"width": self.size[0], "height": self.size[1], **dict(zip(names, self.parameters, strict=False))}
        named = Record(self.record.file, self.record.place, values)
        focal = [named.positive(name) for name in names[:-2]]
        centre = named.number("cx"), named.number("cy")
        return (named.pixels("width"), named.pixels("height")), (focal[0], focal[-1]), centre


@dataclass(frozen=True)
class Pose:
    """One image: quaternion w, x, y, z and translation (7,) from world to camera, its camera's id, and its name."""

    numbers: F64
    camera: int
    name: str


def model_files(folder: Path) -> tuple[Path, Path] | None:
    """The cameras and images files of a sparse model in one of :data:`FOLDERS`; None if there is none."""
    for inner in FOLDERS:
        for ending in (".bin", ".txt"):
            pair = (folder / inner / f"cameras{ending}", folder / inner / f"images{ending}")
            if all(path.is_file() for path in pair):
                return pair
    return None


def warn_of_parts(model: Path) -> None:
    """Tell where COLMAP could not join all photos, and wrote a model of each part: `0` need not be the largest."""
    others = sorted({path.parent.name for path in model.parent.glob("*/images.*")} - {model.name})
    if others:
        message = f"{model} is read, one of {len(others) + 1} models of parts of the photos"
        warnings.warn(f"{message}; give the folder of another: {', '.join(others[:5])}", InputWarning, stacklevel=3)


def colmap_cameras(cameras: Path, images: Path) -> list[Camera]:
    """The cameras of a sparse model, in the order of their photos' names.

    Args:
        cameras, images: of :func:`model_files`.

    Raises:
        InvalidInput: ``input-cameras``.
        OSError: a file cannot be read.
    """
    lenses, poses = _lenses_and_poses(cameras, images)
    used = {number: lenses[number] for _, number, _, _ in poses}
    pinholes = {number: lens.pinhole() for number, lens in used.items()}
    found = [record.camera("pose", pose, *pinholes[number], name) for record, number, pose, name in poses]
    if any(lens.distorts for lens in used.values()):
        warnings.warn(f"{cameras}: lens distortion is ignored", InputWarning, stacklevel=3)
    return sorted(found, key=lambda camera: camera.name)


def colmap_distorted(cameras: Path, images: Path) -> list[Distorted]:
    """The views of a sparse model with their lenses as they are; none where all lenses are pinholes.

    Raises:
        InvalidInput: ``input-cameras``.
        OSError: a file cannot be read.
    """
    lenses, poses = _lenses_and_poses(cameras, images)
    if not any(lenses[number].distorts for _, number, _, _ in poses):
        return []
    used = [(lenses[number], pose, name) for _, number, pose, name in poses]
    return [Distorted(lens.model.name, lens.parameters, *lens.size, pose, name) for lens, pose, name in used]


def _lenses_and_poses(cameras: Path, images: Path) -> tuple[dict[int, Lens], list[tuple[Record, int, F64, str]]]:
    """Lenses by number; for each image its place in the file, number of its lens, (4, 4) pose and name."""
    binary = cameras.suffix == ".bin"
    lenses = dict(_binary_lenses(cameras) if binary else _text_lenses(cameras))
    found = []
    for index, pose in enumerate(_binary_poses(images) if binary else _text_poses(images)):
        record = Record(str(images), f"image {index + 1}", {})
        if pose.camera not in lenses:
            raise record.fault("camera_id", f"camera {pose.camera} is not in {cameras.name}; {EXPORT_AGAIN}")
        found.append((record, pose.camera, _matrix(record, pose), pose.name))
    return lenses, found


def _matrix(record: Record, pose: Pose) -> F64:
    """(4, 4) float64, world to camera."""
    checked = Record(record.file, record.place, {"pose": pose.numbers.tolist()}).numbers("pose", 7)
    length = float(np.linalg.norm(checked[:4]))
    if not length > 1e-6:
        raise record.fault("quaternion", f"a quaternion of length {length:g} is no rotation; {EXPORT_AGAIN}")
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_from_quaternion(checked[None, :4] / length)[0]
    matrix[:3, 3] = checked[4:]
    return matrix


def _lens(record: Record, model: LensModel, size: tuple[int, int], parameters: list[float]) -> Lens:
    if len(parameters) != model.parameters:
        message = f"{model.name} has {model.parameters} parameters, here are {len(parameters)}; {EXPORT_AGAIN}"
        raise record.fault("params", message)
    return Lens(record, model, size, tuple(parameters))


# Binary files


def _binary_lenses(path: Path) -> Iterator[tuple[int, Lens]]:
    with path.open("rb") as stream:
        for index in range(_count(path, stream)):
            record = Record(str(path), f"camera {index + 1}", {})
            camera, model, width, height = struct.unpack("<iiQQ", _exactly(path, stream, 24))
            if not 0 <= model < len(MODELS):
                raise record.fault("model", f"COLMAP's camera model {model} is not known here; use PINHOLE")
            count = MODELS[model].parameters
            parameters = struct.unpack(f"<{count}d", _exactly(path, stream, 8 * count))
            yield camera, _lens(record, MODELS[model], (width, height), list(parameters))


def _binary_poses(path: Path) -> Iterator[Pose]:
    size = path.stat().st_size
    with path.open("rb") as stream:
        for _ in range(_count(path, stream)):
            _image, *numbers, camera = struct.unpack("<I7dI", _exactly(path, stream, 64))
            name = _name(path, stream)
            (keypoints,) = struct.unpack("<Q", _exactly(path, stream, 8))
            if keypoints * _KEYPOINT > size - stream.tell():
                raise _cut(path)
            stream.seek(keypoints * _KEYPOINT, 1)
            yield Pose(np.array(numbers), camera, name)


def _count(path: Path, stream: BinaryIO) -> int:
    (count,) = struct.unpack("<Q", _exactly(path, stream, 8))
    if count > MAX_CAMERAS:
        raise wrong(str(path), f"declares {count} entries, more than {MAX_CAMERAS}: is it a file of COLMAP?")
    return int(count)


def _exactly(path: Path, stream: BinaryIO, length: int) -> bytes:
    data = stream.read(length)
    if len(data) != length:
        raise _cut(path)
    return data


def _name(path: Path, stream: BinaryIO) -> str:
    data = stream.read(MAX_NAME)
    name, end, _rest = data.partition(b"\0")
    if not end:
        raise _cut(path) if len(data) < MAX_NAME else wrong(str(path), f"a name of over {MAX_NAME} bytes")
    stream.seek(len(name) + 1 - len(data), 1)
    return name.decode("utf-8", "replace")


def _cut(path: Path) -> InvalidInput:
    return wrong(str(path), "ends too early: it is cut short or no file of COLMAP; copy or export it again")


# Text files


def _text_lenses(path: Path) -> Iterator[tuple[int, Lens]]:
    by_name = {model.name: model for model in MODELS}
    for number, line in _lines(path):
        record = Record(str(path), f"line {number}", {})
        words = line.split()
        if not words or line.startswith("#"):
            continue
        try:
            camera, width, height = int(words[0]), int(words[2]), int(words[3])
            parameters = [float(word) for word in words[4:]]
        except (IndexError, ValueError) as error:
            raise record.fault("camera", f"expected ID MODEL WIDTH HEIGHT PARAMS...; {EXPORT_AGAIN}") from error
        # A lens that no image uses is no fault, whatever its model is.
        model = by_name.get(words[1].upper(), LensModel(words[1][:40], len(parameters), 0))
        yield camera, _lens(record, model, (width, height), parameters)


def _text_poses(path: Path) -> Iterator[Pose]:
    """The images, each with a line of points after it, or without: some tools leave out empty lines."""
    declared, found, points_due = None, 0, False
    for number, line in _lines(path):
        if line.startswith("#"):
            declared = _count_declared(line) if declared is None else declared
            continue
        if points_due and not _is_image(line):
            points_due = False
            continue
        if not line.strip():
            continue
        found, points_due = found + 1, True
        yield _pose(path, number, line)
    if declared is not None and declared != found:
        message = f"{path}: holds {plural(found, 'image')}, but its header says {declared:,}"
        warnings.warn(message, InputWarning, stacklevel=3)


def _count_declared(comment: str) -> int | None:
    """Images that a comment of the header says there are: `# Number of images: 4, mean observations...`."""
    match comment.lower().replace(",", " ").replace(":", " ").split():
        case ["#", "number", "of", "images", count, *_] if count.isdecimal():
            return int(count)
    return None


def _is_image(line: str) -> bool:
    """Whether a line where points are due is of an image: points are numbers alone, three for each."""
    words = line.split(maxsplit=10)
    return len(words) >= 10 and _are_numbers(words[:9]) and not (len(words) > 10 and _are_numbers(words[9:10]))


def _are_numbers(words: list[str]) -> bool:
    try:
        return all(math.isfinite(float(word)) for word in words)
    except ValueError:
        return False


def _pose(path: Path, number: int, line: str) -> Pose:
    words = line.split(maxsplit=9)
    try:
        return Pose(np.array([float(word) for word in words[1:8]]), int(words[8]), words[9].strip())
    except (IndexError, ValueError) as error:
        message = f"expected ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points; {EXPORT_AGAIN}"
        raise wrong(str(path), message, f"line {number}") from error


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number, from 1, and start of every line: what is beyond :data:`_MAX_LINE` is skipped in pieces."""
    with path.open("rb") as stream:
        number = 0
        while line := stream.readline(_MAX_LINE):
            number += 1
            if number > 4 * MAX_CAMERAS:
                raise wrong(str(path), f"has over {4 * MAX_CAMERAS} lines: is it a file of COLMAP?")
            piece = line
            while not piece.endswith(b"\n") and (piece := stream.readline(_MAX_LINE)):
                pass
            yield number, line.decode("utf-8", "replace").removeprefix("\ufeff" if number == 1 else "")
