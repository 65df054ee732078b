"""The real scenes that are measured: their files and the views they are judged from."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.views import View, make_views
from reference_encoder.options import EncodeOptions
from scarfmt.cli.scenes import Subject
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

REPOSITORY = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("SCAR_DATA", REPOSITORY.parent / "shared" / "data"))


@dataclass(frozen=True)
class Scene:
    """A scene and its views.

    Attributes:
        name: as tables show it.
        path: scene file.
        up: axis that points up in it. The encoder is not told.
        known: camera list the encoder is given; of a split one, its training cameras. None: it runs without options.
        captured: camera list with poses of photos that were held out, where they are known; judged from, too.
        photos: capture folder with photos to compare with, too.
        note: what a reader of the table should know.
        ours: made for this project, so that pictures of it may be published.
        fitted: constants in force (decisions 0023 to 0028) were chosen by trials on it. Older ones were fitted on all.
    """

    name: str
    path: Path
    up: str = "-y"
    known: Path | None = None
    captured: Path | None = None
    photos: Path | None = None
    note: str = ""
    fitted: bool = False

    @property
    def title(self) -> str:
        """The name, with a mark if constants were fitted on the scene."""
        return self.name + (FITTED_MARK if self.fitted else "")

    def options(self, **more: Any) -> EncodeOptions:
        """Encoder options: the defaults, the scene's cameras and `more`."""
        known = None if self.known is None else _part(load_cameras(self.known), "train")
        return EncodeOptions(cameras=known, **more)

    def views(self, original: Subject) -> list[View]:
        """The views all figures come from, never the encoder's. `original` should remember its pictures."""
        held_out = [] if self.captured is None else _part(load_cameras(self.captured), "test")
        return make_views(original, self.up, held_out)


def _part(cameras: list[Camera], split: str) -> list[Camera]:
    return [camera for camera in cameras if camera.split in ("", split)]


FITTED_MARK = " †"
_EXAMPLES = REPOSITORY / "examples"
_SPLATS = DATA / "splats"
_CAPTURE = DATA / "photos" / "plush-on-bed"
_POSES = _CAPTURE / "cameras.json"
_BED = Scene("plush-on-bed", _SPLATS / "plush-on-bed.ply", captured=_POSES, photos=_CAPTURE, fitted=True)

SCENES = (
    Scene(
        "plush-toys",
        _EXAMPLES / "plush-toys.ply",
        captured=_EXAMPLES / "plush-toys.views.json",
        note="the example scene of this repository, SH 3",
        fitted=True,
    ),
    replace(_BED, note="raw float, SH 3"),
    replace(_BED, name="plush-on-bed, poses", known=_POSES, note="the encoder gets the poses of the training photos"),
    Scene("flowers", _SPLATS / "flowers.ply", note="SH 2; its values come from a SOG file, already quantised"),
    Scene("plush-dog", _SPLATS / "plush-dog.ply", note="raw float, SH 3", fitted=True),
    Scene("fruit-drops", _SPLATS / "fruit-drops.ply", note="raw float, SH 3", fitted=True),
    Scene(
        "flower-tile",
        _SPLATS / "flower-tile.ply",
        "z",
        note="raw float, SH 3, of which all rest values are 0",
        fitted=True,
    ),
    Scene("biker", _SPLATS / "biker.spz", note="SPZ file, SH 0"),
    Scene("plant", _SPLATS / "plant.splat", note="`.splat` file, SH 0", fitted=True),
    Scene("angel", _SPLATS / "angel.sog", note="SOG file, SH 0", fitted=True),
    Scene("massa", _SPLATS / "massa.sog", note="SOG file, SH 0"),
    Scene(
        "plush-on-bed, anchors",
        DATA / "anchors" / "plush-on-bed.npz",
        known=_POSES,
        captured=_POSES,
        photos=_CAPTURE,
        note="Scaffold-GS style model, 10 slots an anchor; bytes are per anchor",
    ),
)


def load_gaussians(path: Path, count: int | None = None) -> GaussianScene | AnchorModel:
    """The valid Gaussians of a scene file; of an explicit scene the `count` nearest to its middle (None: all)."""
    source, _ = clean(load(path), drop_invalid=True)
    if count is None or not isinstance(source, GaussianScene):
        return source
    far = np.abs(source.positions - np.median(source.positions, axis=0)).max(axis=1)
    return source.take(np.sort(np.argsort(far, kind="stable")[:count]))


def select_scenes(names: Sequence[str] | None) -> list[Scene]:
    """The scenes of these names (None: all) whose files exist; the others are reported on stderr.

    Raises:
        SystemExit: no scene has that name.
    """
    known = {scene.name: scene for scene in SCENES}
    for name in set(names or ()) - set(known):
        sys.exit(f"no scene is named {name!r}; choose from {', '.join(map(repr, known))}")
    present = []
    for scene in (known[name] for name in names) if names else SCENES:
        needed = [path for path in (scene.path, scene.known, scene.captured, scene.photos) if path is not None]
        if all(path.exists() for path in needed):
            present.append(scene)
        else:
            print(f"skipped {scene.name}: {scene.path} is not here (set SCAR_DATA)", file=sys.stderr)
    return present
