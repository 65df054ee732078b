"""The real scenes that are measured, where they lie, and from where they are looked at."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scarfmt.cli.scenes import Subject
from scarfmt.render.camera import Camera, orbit_cameras
from scarfmt.render.capture import load_cameras

REPOSITORY = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("SCAR_DATA", REPOSITORY.parent / "shared" / "data"))
VIEWS = 8


@dataclass(frozen=True)
class Scene:
    """A scene and its views.

    Attributes:
        name: as tables show it.
        path: scene file.
        frame: of the orbit (`scarfmt.render.camera.Arc`).
        known: camera list the encoder is given instead of `frame`; of a split one, its training cameras.
        judged: camera list pictures are compared from instead of the orbit; of a split one, its test cameras.
        photos: capture folder with photos to compare with, too.
        note: what a reader of the table should know.
        ours: made for this project, so that pictures of it may be published.
    """

    name: str
    path: Path
    frame: str = "-y"
    known: Path | None = None
    judged: Path | None = None
    photos: Path | None = None
    note: str = ""
    ours: bool = False

    def known_cameras(self) -> list[Camera] | None:
        """What the encoder is told of the views; None for the orbit's frame only."""
        return None if self.known is None else _part(load_cameras(self.known), "train")

    def judged_cameras(self, source: Subject) -> list[Camera]:
        """The views all figures are means of: never those the encoder was given."""
        if self.judged is not None:
            return _part(load_cameras(self.judged), "test")
        return orbit_cameras(source.placed, VIEWS, up=self.frame)


def _part(cameras: list[Camera], split: str) -> list[Camera]:
    return [camera for camera in cameras if camera.split in ("", split)]


_EXAMPLES = REPOSITORY / "examples"
_SPLATS = DATA / "splats"
_CAPTURE = DATA / "photos" / "plush-on-bed"
_POSES = _CAPTURE / "cameras.json"

SCENES = (
    Scene(
        "plush-toys",
        _EXAMPLES / "plush-toys.ply",
        known=_EXAMPLES / "plush-toys.cameras.json",
        judged=_EXAMPLES / "plush-toys.views.json",
        note="the example scene of this repository",
        ours=True,
    ),
    Scene(
        "plush-on-bed",
        _SPLATS / "plush-on-bed.ply",
        "-y:125:70",
        photos=_CAPTURE,
        note="raw float, SH 3",
        ours=True,
    ),
    Scene(
        "plush-on-bed, poses",
        _SPLATS / "plush-on-bed.ply",
        known=_POSES,
        judged=_POSES,
        photos=_CAPTURE,
        note="the encoder knows the poses of the training photos; judged from those of the test photos",
    ),
    Scene("flowers", _SPLATS / "flowers.ply", note="SH 2; its values come from a SOG file, already quantised"),
    Scene("plush-dog", _SPLATS / "plush-dog.ply", note="raw float, SH 3"),
    Scene("fruit-drops", _SPLATS / "fruit-drops.ply", "-y:270:70", note="raw float, SH 3"),
    Scene("flower-tile", _SPLATS / "flower-tile.ply", "z", note="raw float, SH 3, of which all rest values are 0"),
    Scene("biker", _SPLATS / "biker.spz", note="SPZ file, SH 0"),
    Scene("biker, PLY", _SPLATS / "biker.compressed.ply", note="PlayCanvas compressed PLY, SH 0"),
    Scene("plant", _SPLATS / "plant.splat", note="`.splat` file, SH 0"),
    Scene("angel", _SPLATS / "angel.sog", note="SOG file, SH 0"),
    Scene("massa", _SPLATS / "massa.sog", note="SOG file, SH 0"),
    Scene(
        "plush-on-bed, anchors",
        DATA / "anchors" / "plush-on-bed.npz",
        known=_POSES,
        judged=_POSES,
        photos=_CAPTURE,
        note="Scaffold-GS style model, 10 slots an anchor; bytes are per anchor",
    ),
)


def chosen(names: Sequence[str] | None) -> list[Scene]:
    """The scenes of those names (None: all) whose files are here; says on stderr which are not.

    Raises:
        SystemExit: no scene has that name.
    """
    known = {scene.name: scene for scene in SCENES}
    for name in set(names or ()) - set(known):
        sys.exit(f"no scene is called {name!r}: choose from {', '.join(map(repr, known))}")
    present = []
    for scene in (known[name] for name in names) if names else SCENES:
        needed = [path for path in (scene.path, scene.known, scene.judged, scene.photos) if path is not None]
        if all(path.exists() for path in needed):
            present.append(scene)
        else:
            print(f"skipped {scene.name}: {scene.path} is not here (set SCAR_DATA)", file=sys.stderr)
    return present
