"""Whether the poses of a capture fit its photos: how far matched points are from where another photo puts them.

    python -m benchmarks.poses truck-half CAPTURE --every 3
    python -m benchmarks.poses --report

Points are matched between all pairs of every Nth photo (pycolmap, extra ``poses``), and measured against the poses that
the capture gives, which they had no part in: the Sampson distance to the epipolar line, in pixels. Photos that follow
one another fit in any capture; where a walk comes back to what it saw, poses may have drifted. A pair of photos in
which one thing looks like another is matched wrongly now and then: medians count, the worst pair does not.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from os.path import commonpath
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import provenance
from benchmarks.report import SKIPPED, dated, load_document, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY
from reference_encoder.training.capture import Capture, Photo, load_capture
from scarfmt.arrays import F64
from scarfmt.render.camera import Camera

NAME = "poses"
PAGE = REPOSITORY / "docs" / "trained.md"
_FEATURES = 1500
_LEAST_MATCHES = 30
NEAR = 12
"""Photos apart in the order of their names, at most, that count as following one another."""


@dataclass(frozen=True)
class Fit:
    """How well pairs of photos fit together.

    Attributes:
        pairs: of photos in which enough is the same.
        median, most: pixels, of the pairs' median distances: their median, and what nine of ten stay below.
    """

    pairs: int
    median: float
    most: float

    @classmethod
    def of(cls, distances: Sequence[float]) -> Fit | None:
        """The fit from the pairs' median distances, pixels; None if there are none."""
        if not distances:
            return None
        return cls(len(distances), float(np.median(distances)), float(np.quantile(distances, 0.9)))


def sampson(one: Camera, other: Camera, left: F64, right: F64) -> F64:
    """(n,) pixels, about, that (n, 2) places in one photo and in the other are from showing the same points."""
    relative = other.world_to_camera @ np.linalg.inv(one.world_to_camera)
    x, y, z = relative[:3, 3]
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    fundamental = _inverse(other).T @ across @ relative[:3, :3] @ _inverse(one)
    here, there = (np.column_stack([places, np.ones(len(places))]) for places in (left, right))
    lines, back = here @ fundamental.T, there @ fundamental
    slopes = (lines[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1)
    found: F64 = np.abs((there * lines).sum(axis=1)) / np.sqrt(slopes)
    return found


def _inverse(camera: Camera) -> F64:
    return np.linalg.inv(np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]))


def matched(photos: Sequence[Photo], folder: Path) -> Iterator[tuple[int, int, F64, F64]]:
    """Pairs of photos, by number, in which enough is the same, and (n, 2) places of it in each.

    Args:
        folder: for what is made on the way.
    """
    import pycolmap

    root = Path(commonpath([photo.path.parent for photo in photos]))
    numbers = {photo.path.relative_to(root).as_posix(): number for number, photo in enumerate(photos)}
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.sift.max_num_features = _FEATURES
    database = folder / "database.db"
    names = list(numbers)
    pycolmap.extract_features(database, root, image_names=names, extraction_options=extraction)
    pycolmap.match_exhaustive(database)
    with pycolmap.Database.open(database) as found:
        images = {image.image_id: numbers[image.name] for image in found.read_all_images()}
        places = {key: np.array(found.read_keypoints(key), np.float64)[:, :2] for key in images}
        for pair, geometry in zip(*found.read_two_view_geometries(), strict=True):
            one, other = pycolmap.pair_id_to_image_pair(pair)
            matches = np.array(geometry.inlier_matches)
            if len(matches) >= _LEAST_MATCHES:
                yield images[one], images[other], places[one][matches[:, 0]], places[other][matches[:, 1]]


def fits(capture: Capture, every: int) -> dict[str, Fit | None]:
    """How well photos that follow one another fit, and those that do not."""
    chosen = capture.photos[::every]
    found: dict[str, list[float]] = {"near": [], "far": []}
    with tempfile.TemporaryDirectory() as folder:
        for one, other, left, right in matched(chosen, Path(folder)):
            distances = sampson(chosen[one].camera, chosen[other].camera, left, right)
            kind = "near" if abs(one - other) * every <= NEAR else "far"
            found[kind].append(float(np.median(distances)))
    return {kind: Fit.of(distances) for kind, distances in found.items()}


def tables(results: dict[str, Any]) -> str:
    """A row a capture."""
    head = ["capture", "photos", "pairs that follow", "median, px", "90 %", "pairs that do not", "median, px", "90 %"]
    rows = [
        [name, str(record["photos"]), *_cells(record["near"]), *_cells(record["far"])]
        for name, record in results.items()
    ]
    return table(head, rows)


def _cells(found: dict[str, float] | None) -> list[str]:
    return ["–"] * 3 if found is None else [str(found["pairs"]), f"{found['median']:.2f}", f"{found['most']:.2f}"]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="?", help="name of the capture on the page")
    parser.add_argument("capture", nargs="?", type=Path, help="capture as for `scarfmt train`, with poses")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="look at every Nth photo [default: all]")
    parser.add_argument("--report", action="store_true", help="only rewrite docs/trained.md")
    parser.add_argument("--no-write", action="store_true", help="print the table; JSON goes to build/bench/ only")
    said = parser.parse_args(arguments)
    keep = not said.no_write
    results = provenance.figures(load_document(NAME, keep))
    if not said.report:
        if said.name is None or said.capture is None:
            parser.error("a capture and a name for it are needed")
        if importlib.util.find_spec("pycolmap") is None:
            print("pycolmap is not installed: pip install 'scarfmt[poses]'", file=sys.stderr)
            return SKIPPED
        capture = load_capture(said.capture)
        found = {kind: fit and asdict(fit) for kind, fit in fits(capture, said.every).items()}
        results[said.name] = {"photos": len(capture.photos[:: said.every]), **found}
        save_results(NAME, results, keep, [said.name])
    text = dated(tables(results), NAME, keep)
    if keep:
        replace_section(NAME, text, PAGE)
    else:
        print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
