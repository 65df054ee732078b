"""The actions of COLMAP in a process of its own: ``python -m`` this module, with ACTION and FOLDER.

FOLDER holds photos in `input/`. ACTION ``poses`` finds their poses; it reads pairs of photos that look alike from
`pairs.txt`. ACTION ``undistort`` reads poses and lenses from `model/`. Both leave `images/` and `sparse/` in FOLDER, of
pinhole cameras. Progress is JSON on standard output, ``{"stage": ..., "part": 0..1}``; an error's last line says why.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pycolmap

from reference_encoder.training.poses import INPUT, MODEL, PAIRS

FEATURES = 3000
LARGEST_SIDE = 1600
"""Pixels in which features are looked for: in larger photos they are hardly better placed, and take far longer."""
SMALL_SIDE = 1000
"""Pixels; photos that are smaller have few features, which are also looked for in a picture of twice the size."""
JPEG_QUALITY = 98


def main(arguments: list[str]) -> int:
    """Do what the arguments say; returns the exit status."""
    action, folder = arguments[0], Path(arguments[1])
    pycolmap.set_random_seed(0)
    if action == "poses" and not find_poses(folder):
        print("no two photos show the same thing from different sides; more have to overlap", file=sys.stderr)
        return 1
    _tell("undistort the photos", 0.95)
    pycolmap.undistort_images(folder, folder / MODEL, folder / INPUT, jpeg_quality=JPEG_QUALITY)
    return 0


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
