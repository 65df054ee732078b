"""Sheets of the layers of a scene: docs/images/plush-toys-layers.jpg for README.md, others for a look at them.

    python -m benchmarks.pictures [--scenes NAME ...] [--quality 47] [--short] [--no-write]

Uses the file that `benchmarks.quality` left in build/benchmarks/, or encodes it. Sheets of other scenes are written
there too; with --no-write, all are.
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image

from benchmarks.encode_cache import encode_scene
from benchmarks.judge import judge
from benchmarks.report import SCRATCH, make_parser
from benchmarks.scenes import REPOSITORY, Scene, select_scenes
from reference_encoder.options import EncodeOptions
from scarfmt.arrays import F32
from scarfmt.cli.scenes import Subject, layer_table, load_subject
from scarfmt.render.camera import Camera
from scarfmt.render.images import contact_sheet, to_bytes

IMAGES = REPOSITORY / "docs" / "images"
WIDTH, HEIGHT = 320, 240
COLUMNS = 3
ZOOM, MIDDLE = 1.6, (0.53, 0.42)
"""How many times narrower the part shown is than the picture, and its middle as parts of width and height."""
PUBLISHED = "plush-toys"
# For looking at, not for measuring: a PNG of the same sheet is five times as large.
JPEG_QUALITY = 90


def draw_part(subject: Subject, view: Camera) -> F32:
    """(HEIGHT, WIDTH, 3) part of the picture from a view, `ZOOM` times narrower, about `MIDDLE`."""
    camera = view.scale(ZOOM * WIDTH / view.width)
    left, top = (
        min(max(round(middle * size - part / 2), 0), size - part)
        for middle, size, part in zip(MIDDLE, (camera.width, camera.height), (WIDTH, HEIGHT), strict=True)
    )
    return subject.picture(camera)[top : top + HEIGHT, left : left + WIDTH]


def draw_sheet(scene: Scene, quality: float, publish: bool = True) -> Path:
    """Draw the sheet of one scene: its layers with bytes per Gaussian, mean and worst PSNR, then the source."""
    path = encode_scene(scene, quality, EncodeOptions().effort)["path"]
    original = load_subject(str(scene.path)).remembering()
    views = scene.views(original)
    view = next((view.camera for view in views if view.kind == "capture"), views[0].camera)
    pictures, labels = [], []
    for row in layer_table(path):
        decoded = load_subject(path, row["layer"])
        found = judge(original, decoded, views)
        pictures.append(draw_part(decoded, view))
        level = f"{found['psnr_db']:.1f} dB, worst {found['worst_psnr_db']:.1f}"
        labels.append(f"layer {row['layer']}: {row['bytes_per_source']:.2f} B/Gaussian, {level}")
    size = scene.path.stat().st_size / len(original.placed)
    pictures.append(draw_part(original, view))
    labels.append(f"source: {size:.0f} B/Gaussian")
    folder = IMAGES if scene.name == PUBLISHED and publish else SCRATCH
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{scene.name}-layers.jpg"
    image = Image.fromarray(to_bytes(contact_sheet(pictures, labels, COLUMNS)))
    image.save(target, quality=JPEG_QUALITY, subsampling=0, optimize=True)
    return target


def main() -> None:
    parser = make_parser(__doc__, report=False)
    parser.add_argument("--quality", type=float)
    arguments = parser.parse_args()
    short = arguments.short
    quality = arguments.quality or (45.0 if short else 47.0)
    for scene in select_scenes(arguments.scenes or [PUBLISHED]):
        target = draw_sheet(scene, quality, publish=not arguments.no_write)
        print(f"{target.relative_to(REPOSITORY)}: {target.stat().st_size:,} bytes", file=sys.stderr)


if __name__ == "__main__":
    main()
