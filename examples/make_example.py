"""Makes the example scene: the small plush toys cut out of a room captured with a phone.

    python examples/make_example.py SCENE.ply CAPTURE/cameras.json

`SCENE.ply` is the whole trained room (249,960 Gaussians), `cameras.json` the poses of the photos it was trained from.
The same inputs give the same files, next to this script.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from scarfmt.api import save
from scarfmt.arrays import F64
from scarfmt.formats import load
from scarfmt.render.camera import Camera, look_at
from scarfmt.render.capture import load_cameras
from scarfmt.scene.gaussians import GaussianScene

FOLDER = Path(__file__).resolve().parent
NAME = "plush-toys"
# The middle of the group of toys and the ball round it that is kept, world units of the capture.
CENTRE = np.array([-1.05, -0.5, 6.25])
RADIUS = 2.05
# Larger Gaussians belong to the wall, and would hang in the air as fog once the wall is cut away.
LARGEST_LOG_SCALE = -1.2
# Photos with a free sight of the toys: in turn, where the encoder looks from and where pictures are judged from.
EYES = (*range(7, 17), *range(86, 92))
FIELD_OF_VIEW_DEG = 22.0
WIDTH, HEIGHT = 480, 360


def crop(scene: GaussianScene) -> GaussianScene:
    """The Gaussians of the toys, in the order and with the values they have in `scene`."""
    near = np.linalg.norm(scene.positions - CENTRE, axis=1) < RADIUS
    return scene.take(near & (scene.log_scales.max(axis=1) < LARGEST_LOG_SCALE))


def views(photos: list[Camera]) -> list[Camera]:
    """Cameras at the eyes of `EYES`, turned to the toys and zoomed in."""
    upward: F64 = -np.mean([camera.world_to_camera[1, :3] for camera in photos], axis=0)
    eyes = [(photos[number].centre, photos[number].name) for number in EYES]
    return [look_at(eye, CENTRE, upward, WIDTH, HEIGHT, FIELD_OF_VIEW_DEG, name) for eye, name in eyes]


def write_cameras(path: Path, cameras: list[Camera]) -> None:
    """Write `cameras` in the layout `scarfmt --cameras` reads."""
    entries = [
        {
            "name": camera.name,
            "W": camera.width,
            "H": camera.height,
            **{key: round(getattr(camera, key), 6) for key in ("fx", "fy", "cx", "cy")},
            "world_to_camera": camera.world_to_camera.round(9).tolist(),
        }
        for camera in cameras
    ]
    lines = ",\n".join(json.dumps(entry) for entry in entries)
    path.write_text(f'{{"images": [\n{lines}\n]}}\n', encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="the whole trained room, INRIA PLY")
    parser.add_argument("cameras", type=Path, help="cameras.json of the capture")
    arguments = parser.parse_args()
    scene = load(arguments.scene)
    if not isinstance(scene, GaussianScene):
        parser.error(f"{arguments.scene} holds anchors, not Gaussians")
    toys = crop(scene)
    save(toys, FOLDER / f"{NAME}.ply", force=True)
    cameras = views(load_cameras(arguments.cameras))
    write_cameras(FOLDER / f"{NAME}.cameras.json", cameras[0::2])
    write_cameras(FOLDER / f"{NAME}.views.json", cameras[1::2])
    print(f"{len(toys):,} Gaussians, {(FOLDER / f'{NAME}.ply').stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
