"""A photo that was held out, and each layer of a trained file from where it was taken, side by side.

    python -m benchmarks.trained_picture scene.scar CAPTURE docs/images/out.jpg --photo 8
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.photos import drawn, held_out
from reference_encoder.training.capture import Photo, pixels
from scarfmt.api import decode_scene, inspect, truncate
from scarfmt.arrays import U8

GAP = 6
"""White pixels between two."""


def side_by_side(data: bytes, photo: Photo) -> U8:
    """(height, width, 3) uint8: layers from the first, then the photo."""
    layers = range(1, int(inspect(data)["layer_count"]) + 1)
    pictures = [drawn(decode_scene(truncate(data, layer)), photo.camera) * 255 for layer in layers]
    gap = np.full((photo.camera.height, GAP, 3), 255, np.uint8)
    parts = [part for picture in pictures for part in (np.rint(picture).astype(np.uint8), gap)]
    return np.concatenate([*parts, pixels(photo)], axis=1)


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("file", type=Path, help="a .scar")
    parser.add_argument("capture", type=Path, help="capture that it was trained from")
    parser.add_argument("out", type=Path, help=".jpg or .png")
    parser.add_argument("--photo", type=int, default=0, help="number of the photo among those held out")
    parser.add_argument("--width", type=int, default=1600, help="maximum width of all pictures together, pixels")
    said = parser.parse_args(arguments)
    found = Image.fromarray(side_by_side(said.file.read_bytes(), held_out(said.capture, None)[said.photo]))
    found.thumbnail((said.width, said.width), Image.Resampling.LANCZOS)
    found.save(said.out, quality=88)


if __name__ == "__main__":
    main(sys.argv[1:])
