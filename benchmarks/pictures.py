"""Sheets of the layers of a scene: docs/images/NAME-layers.jpg for scenes of ours, for README.md and docs/.

    python -m benchmarks.pictures [--scenes NAME ...] [--quality 47] [--effort 2] [--short] [--no-write]

Uses the file that `benchmarks.quality` left in build/benchmarks/, or encodes it. Sheets of scenes that others made are
written there too, as not all of them may be published; with --no-write, all are.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from benchmarks.encoded import encoded
from benchmarks.judged import judgement
from benchmarks.report import SCRATCH, add_arguments
from benchmarks.scenes import REPOSITORY, Scene, chosen
from benchmarks.views import View
from scarfmt.arrays import F32
from scarfmt.cli.scenes import Subject, layer_table, load_subject
from scarfmt.render.images import contact_sheet, to_bytes

IMAGES = REPOSITORY / "docs" / "images"
WIDTH, HEIGHT = 320, 240
COLUMNS = 3
# For looking at, not for measuring: a PNG of the same sheet is five times as large.
JPEG_QUALITY = 90


@dataclass(frozen=True)
class Detail:
    """The part of a picture that is shown.

    Attributes:
        view: number among the views of a kind.
        kind: one of `benchmarks.views.KINDS`.
        zoom: how many times narrower the part is than the picture.
        x, y: its middle, as parts of the picture's width and height.
    """

    view: int = 0
    zoom: float = 1.0
    x: float = 0.5
    y: float = 0.5
    kind: str = "orbit"

    def of(self, subject: Subject, views: Sequence[View]) -> F32:
        """(HEIGHT, WIDTH, 3) picture of this part."""
        whole = [view.camera for view in views if view.kind == self.kind][self.view]
        camera = whole.scaled(self.zoom * WIDTH / whole.width)
        picture = subject.picture(camera)
        left = min(max(round(self.x * camera.width - WIDTH / 2), 0), camera.width - WIDTH)
        top = min(max(round(self.y * camera.height - HEIGHT / 2), 0), camera.height - HEIGHT)
        return picture[top : top + HEIGHT, left : left + WIDTH]


DETAILS = {
    "plush-toys": Detail(0, 1.6, 0.53, 0.42, "capture"),
    "plush-on-bed": Detail(6, 1.3, 0.5, 0.5, "capture"),
    "flowers": Detail(3, 1.3, 0.5, 0.45, "near"),
    "plush-dog": Detail(3, kind="near"),
}


def sheet(scene: Scene, quality: float, effort: int, publish: bool = True) -> Path:
    """Draw the sheet of one scene: its layers with bytes per Gaussian, mean and worst PSNR, then the source."""
    path = encoded(scene, quality, effort)["path"]
    original = load_subject(str(scene.path)).remembering()
    views = scene.judged_views(original)
    detail = DETAILS.get(scene.name, Detail())
    pictures, labels = [], []
    for row in layer_table(path):
        decoded = load_subject(path, row["layer"])
        found = judgement(original, decoded, views)
        pictures.append(detail.of(decoded, views))
        level = f"{found['psnr_db']:.1f} dB, worst {found['worst_psnr_db']:.1f}"
        labels.append(f"layer {row['layer']}: {row['bytes_per_source']:.2f} B/Gaussian, {level}")
    size = scene.path.stat().st_size / len(original.placed)
    pictures.append(detail.of(original, views))
    labels.append(f"source: {size:.0f} B/Gaussian")
    folder = IMAGES if scene.ours and publish else SCRATCH
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{scene.name}-layers.jpg"
    image = Image.fromarray(to_bytes(contact_sheet(pictures, labels, COLUMNS)))
    image.save(target, quality=JPEG_QUALITY, subsampling=0, optimize=True)
    return target


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--quality", type=float)
    parser.add_argument("--effort", type=int)
    arguments = parser.parse_args()
    short = arguments.short
    quality, effort = arguments.quality or (45.0 if short else 47.0), arguments.effort or (1 if short else 2)
    for scene in chosen(arguments.scenes or (["plush-toys"] if short else list(DETAILS))):
        target = sheet(scene, quality, effort, publish=not arguments.no_write)
        print(f"{target.relative_to(REPOSITORY)}: {target.stat().st_size:,} bytes", file=sys.stderr)


if __name__ == "__main__":
    main()
