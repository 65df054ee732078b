"""The actions of COLMAP in a process of its own: ``python -m`` this module, with ACTION and FOLDER.

FOLDER holds photos in `input/`. ACTION ``poses`` finds their poses; it reads pairs of photos that look alike from
`pairs.txt`. ACTION ``undistort`` reads poses and lenses from `model/`. Both leave `images/` and `sparse/` in FOLDER, of
pinhole cameras. Photos are made anew only if a lens distorts: made anew they are blur. Progress is JSON on standard
output, ``{"stage": ..., "part": 0..1}``; an error's last line says why.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pycolmap

from reference_encoder.training.poses import INPUT, MODEL, PAIRS

FEATURES = 3000
LARGEST_SIDE = 1600
"""Pixels in which features are looked for: in larger photos they are hardly better placed, and take far longer."""
SMALL_SIDE = 1000
"""Pixels; photos that are smaller have few features, which are also looked for in a picture of twice the size."""
JPEG_QUALITY = 98
STRAIGHT = 0.25
"""Pixels by which a lens may distort for its photos to be taken as they are."""
AS_GOOD = 1.01
"""Mean reprojection error of pinholes, parts of that of the lenses, up to which photos are taken as they are: few
photos do not say what a lens does at its edges."""
_GRID = 33
"""Places a side at which a distortion is measured."""


def main(arguments: list[str]) -> int:
    """Do what the arguments say; returns the exit status."""
    action, folder = arguments[0], Path(arguments[1])
    pycolmap.set_random_seed(0)
    if action == "poses" and not find_poses(folder):
        print("no two photos show the same thing from different sides; more have to overlap", file=sys.stderr)
        return 1
    _tell("undistort the photos", 0.95)
    lenses = pycolmap.Reconstruction(folder / MODEL)
    straight = fit_pinholes(lenses)
    if straight is None:
        pycolmap.undistort_images(folder, folder / MODEL, folder / INPUT, jpeg_quality=JPEG_QUALITY)
    else:
        (folder / "sparse").mkdir()
        straight.write(folder / "sparse")
        shutil.copytree(folder / INPUT, folder / "images")
    return 0


def fit_pinholes(lenses: pycolmap.Reconstruction) -> pycolmap.Reconstruction | None:
    """The model with pinhole cameras, their poses fitted anew if there are points; None if lenses distort."""
    distorts = any(not distortion(camera) <= STRAIGHT for camera in lenses.cameras.values())
    if distorts and not lenses.num_points3D():
        return None
    made = pycolmap.Reconstruction(lenses)
    for camera in made.cameras.values():
        pinhole = _pinhole(camera)
        camera.model, camera.params = pinhole.model, pinhole.params
    if made.num_points3D():
        pycolmap.bundle_adjustment(made)
        made.update_point_3d_errors()
    as_good = made.compute_mean_reprojection_error() <= AS_GOOD * lenses.compute_mean_reprojection_error()
    return made if as_good or not distorts else None


def distortion(camera: pycolmap.Camera) -> float:
    """Pixels between where a lens and a pinhole of its focal lengths show a direction, the most over the photo."""
    across, down = np.linspace(0, camera.width, _GRID), np.linspace(0, camera.height, _GRID)
    straight = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    pinhole = _pinhole(camera)
    directions = np.concatenate([pinhole.cam_from_img(straight), np.ones((len(straight), 1))], axis=1)
    return float(np.linalg.norm(camera.img_from_cam(directions) - straight, axis=1).max())


def _pinhole(camera: pycolmap.Camera) -> pycolmap.Camera:
    """The pinhole camera with the same focal lengths and middle; one focal length stays one."""
    focal = [camera.params[index] for index in camera.focal_length_idxs()]
    middle = [camera.principal_point_x, camera.principal_point_y]
    model = "SIMPLE_PINHOLE" if len(focal) == 1 else "PINHOLE"
    return pycolmap.Camera(model=model, width=camera.width, height=camera.height, params=focal + middle)


def find_poses(folder: Path) -> bool:
    """Write the largest model that the photos make to `model/`; whether there is one."""
    database, photos = folder / "database.db", folder / INPUT
    _tell("find poses: features", 0.0)
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.max_image_size = LARGEST_SIDE
    extraction.sift.max_num_features = FEATURES
    # Not from a picture of twice the size, as is usual, where there is enough to see: four times faster.
    extraction.sift.first_octave = -1 if _largest_side(photos) < SMALL_SIDE else 0
    pycolmap.extract_features(
        database, photos, camera_mode=pycolmap.CameraMode.PER_FOLDER, extraction_options=extraction
    )
    _tell("find poses: neighbours", 0.3)
    pycolmap.match_sequential(database)
    _tell("find poses: photos alike", 0.5)
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path = folder / PAIRS
    pycolmap.match_image_pairs(database, pairing_options=pairing)
    best = _largest_model(folder, database, photos)
    if best is not None:
        (folder / MODEL).mkdir()
        best.write(folder / MODEL)
    return best is not None


def _largest_side(photos: Path) -> int:
    """The larger side of the first photo, pixels."""
    first = pycolmap.Bitmap.read(min(file for file in photos.rglob("*") if file.is_file()), as_rgb=False)
    assert first is not None  # Pillow has read all of them.
    return int(max(first.width, first.height))


def _largest_model(folder: Path, database: Path, photos: Path) -> pycolmap.Reconstruction | None:
    count = sum(1 for file in photos.rglob("*") if not file.is_dir())
    placed = [0]

    def one_more() -> None:
        placed[0] += 1
        _tell("find poses: solve", 0.6 + 0.35 * min(1.0, placed[0] / count))

    options = pycolmap.IncrementalPipelineOptions()
    options.min_model_size = min(3, count)
    options.random_seed = 0
    _tell("find poses: solve", 0.6)
    (folder / "models").mkdir()
    models = pycolmap.incremental_mapping(database, photos, folder / "models", options, next_image_callback=one_more)
    return max(models.values(), key=lambda model: model.num_reg_images(), default=None)


def _tell(stage: str, part: float) -> None:
    print(json.dumps({"stage": stage, "part": part}), flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
