"""Trained files and a 3DGS model of the same photos in several formats, against the held-out photos.

    python -m benchmarks.trained plush-on-bed CAPTURE --scar "an hour=plush.scar" --ply plush-on-bed.ply
    python -m benchmarks.trained truck-half CAPTURE --model whole.scar --post-hoc "quality 38=encoded.scar"
    python -m benchmarks.trained plush-on-bed CAPTURE --scar plush.scar --picture docs/images/out.jpg --photo 8
    python -m benchmarks.trained --short --no-write         trains some iterations on pictures of the example scene
    python -m benchmarks.trained --report                   only rewrite the tables from earlier results

Of each number of layers: the bytes of the file cut there, and of what it decodes to PSNR and SSIM, of pictures rounded
to 8 bits, and FLIP (Andersson et al. 2020; NVIDIA's package `flip-evaluator`, 67 pixels a degree) where that is
installed. A picture that equals its photo counts as 100 dB: JSON has no infinity, and a mean of it says nothing. The
PLY is measured as it is, as SOG and SPZ (needs node and npm), and layer by layer as the `.scar` that `scarfmt encode`
makes of it with the cameras of the training photos.
Results are merged into benchmarks/results/trained.json by scene and file; those of photos of another size are dropped.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from PIL import Image

from benchmarks import provenance
from benchmarks.encode_cache import cache_path, file_key
from benchmarks.judge import EQUAL_DB, bytes_at
from benchmarks.report import RESULTS_PAGE, add_provenance, load_document, replace_section, save_results, table
from benchmarks.rivals import write_rival
from benchmarks.rivals_formats import list_formats, read
from benchmarks.rivals_tools import ToolFailed, install
from benchmarks.scenes import REPOSITORY, Scene, load_gaussians
from reference_decoder.anchors import gaussians
from reference_decoder.decode import decode_scene
from reference_encoder.options import EncodeOptions
from reference_encoder.training.capture import Capture, Photo, load_capture, pixels
from reference_encoder.training.options import TrainOptions
from scarfmt.api import encode, inspect, train, truncate
from scarfmt.arrays import F32
from scarfmt.atomic import atomic_write
from scarfmt.formats.clean import clean
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.render.images import write_png
from scarfmt.render.metrics import psnr, ssim
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

NAME = "trained"
QUALITIES, FORMATS = (41.0, 47.0), ("sog", "spz")
KINDS = ("trained", "model", "post-hoc", "rival")
"""What a file is: trained with its rate, trained without, made by `encode` of a model, another format."""
SHOWN = ("trained", "model", "rival")
"""Kinds with rows of their own; post-hoc files stand in the shares."""
SHORT_ITERATIONS = 60

Perceptual = Callable[[F32, F32], float]
"""A metric of (original, picture), each (height, width, 3) float32, 0..1."""
HEAD = ("kB", "PSNR, dB", "worst", "SSIM", "FLIP")
GAP = 6
"""White pixels between two pictures."""
Record = dict[str, Any]
Point = tuple[float, float]
"""PSNR in dB, and bytes."""


# Measuring


@dataclass(frozen=True)
class Figures:
    """The bytes and the quality of a file.

    Attributes:
        file_bytes: of the file.
        psnr_db, worst_psnr_db, ssim: mean and worst over the photos; at most `EQUAL_DB`.
        flip: mean over the photos; None where its package is not installed.
    """

    file_bytes: int
    psnr_db: float
    worst_psnr_db: float
    ssim: float
    flip: float | None = None

    def cells(self) -> list[str]:
        """The cells of a table under `HEAD`."""
        levels = [f"{value:.2f}" for value in (self.psnr_db, self.worst_psnr_db)]
        flip = "–" if self.flip is None else f"{self.flip:.4f}"
        return [f"{self.file_bytes / 1000:,.1f}", *levels, f"{self.ssim:.4f}", flip]


def load_flip() -> Perceptual | None:
    """Mean FLIP error of a picture; None, with a line on stderr, where its package is not installed."""
    try:
        import flip_evaluator
    except ImportError:
        print("no FLIP: pip install flip-evaluator", file=sys.stderr)
        return None

    def error(original: F32, picture: F32) -> float:
        return float(flip_evaluator.evaluate(original, picture, "LDR", applyMagma=False)[1])

    return error


def draw(scene: GaussianScene | AnchorModel, camera: Camera) -> F32:
    """(height, width, 3) float32 picture over black, rounded to 8 bits, 0..1."""
    if isinstance(scene, AnchorModel):
        seen = gaussians(scene, camera.centre)
        picture = render(seen.scene, camera, colours=seen.colours)
    else:
        picture = render(scene, camera)
    return np.asarray(np.rint(np.clip(picture, 0, 1) * np.float32(255)) / np.float32(255), np.float32)


def measure(
    scene: GaussianScene | AnchorModel, file_bytes: int, photos: Sequence[Photo], flip: Perceptual | None = None
) -> Figures:
    """Compare what a file of `file_bytes` decodes to with `photos`, at least one."""
    levels, structure, errors = [], [], []
    for photo in photos:
        original, picture = pixels(photo).astype(np.float32) / np.float32(255), draw(scene, photo.camera)
        levels.append(min(psnr(picture, original), EQUAL_DB))
        structure.append(ssim(picture, original))
        errors += [] if flip is None else [flip(original, picture)]
    error = float(np.mean(errors)) if errors else None
    return Figures(file_bytes, float(np.mean(levels)), min(levels), float(np.mean(structure)), error)


def measure_layers(data: bytes, photos: Sequence[Photo], flip: Perceptual | None = None) -> Iterator[Figures]:
    """Figures of each layer of a file, from the first; arguments as for :func:`measure`."""
    for layers in range(1, int(inspect(data)["layer_count"]) + 1):
        cut = truncate(data, layers)
        yield measure(decode_scene(cut), len(cut), photos, flip)


def draw_side_by_side(data: bytes, photo: Photo, width: int) -> Image.Image:
    """The layers of a file from the first, then the photo, together at most `width` pixels wide."""
    layers = range(1, int(inspect(data)["layer_count"]) + 1)
    pictures = [draw(decode_scene(truncate(data, layer)), photo.camera) * 255 for layer in layers]
    gap = np.full((photo.camera.height, GAP, 3), 255, np.uint8)
    parts = [part for picture in pictures for part in (np.rint(picture).astype(np.uint8), gap)]
    image = Image.fromarray(np.concatenate([*parts, pixels(photo)], axis=1))
    image.thumbnail((width, width), Image.Resampling.LANCZOS)
    return image


def make_record(name: str, kind: str, figures: Figures, layers: int = 1, iterations: int | None = None) -> Record:
    """What is kept of a file.

    Args:
        kind: one of `KINDS`.
        figures: of the file cut there.
        layers: of the file, from the first; 1 for formats without.
        iterations: of its training, None where the file does not say.
    """
    return {"name": name, "kind": kind, "layers": layers, "iterations": iterations, "figures": asdict(figures)}


def measure_scar(name: str, kind: str, data: bytes, capture: Capture, flip: Perceptual | None) -> Iterator[Record]:
    """A record of each layer of a `.scar`."""
    training = (inspect(data, metadata=True).get("metadata") or {}).get("training") or {}
    for layers, found in enumerate(measure_layers(data, capture.test, flip), 1):
        yield make_record(name, kind, found, layers, training.get("iterations"))


def encode_model(scene: Scene, capture: Capture, quality: float) -> bytes:
    """The `.scar` that `scarfmt encode` makes of a model; cached until encoder, model or photos change."""
    path = cache_path(scene, f"q{quality:g}-photos-{capture.digest[:12]}")
    if not path.exists():
        options = EncodeOptions(quality=quality, cameras=[photo.camera for photo in capture.train])
        with atomic_write(path) as stream:
            stream.write(encode(scene.path, options))
    return path.read_bytes()


def measure_model(
    scene: Scene, capture: Capture, arguments: argparse.Namespace, flip: Perceptual | None
) -> Iterator[Record]:
    """Records of a model that is a PLY: itself, in other formats, and encoded."""
    model = load_gaussians(scene.path)
    assert isinstance(model, GaussianScene)
    own = measure(model, scene.path.stat().st_size, capture.test, flip)
    yield make_record("3DGS, .ply", "rival", own)
    missing = install()
    for rival in list_formats(model, few=True):
        if rival.family not in FORMATS:
            continue
        try:
            if missing:
                raise ToolFailed(missing)
            path, _ = write_rival(scene, scene.path, rival, fresh=False)
        except ToolFailed as error:
            print(f"skipped {rival.name}: {error}", file=sys.stderr)
            continue
        stored, _ = clean(read(path, rival.scale), drop_invalid=True)
        found = measure(stored, path.stat().st_size, capture.test, flip)
        yield make_record(f"3DGS, {rival.name}", "rival", found)
    for quality in arguments.qualities:
        data = encode_model(scene, capture, quality)
        yield from measure_scar(f"3DGS, `encode --quality {quality:g}`", "post-hoc", data, capture, flip)


def measure_all(arguments: argparse.Namespace, capture: Capture, flip: Perceptual | None) -> Iterator[Record]:
    """Everything that the command line names."""
    files = (("trained", arguments.scar), ("model", arguments.model), ("post-hoc", arguments.post_hoc))
    for kind, words in files:
        for word in words:
            name, _, path = word.rpartition("=")
            yield from measure_scar(name or Path(path).stem, kind, Path(path).read_bytes(), capture, flip)
    if arguments.ply is not None:
        scene = Scene(f"{arguments.scene}-{file_key(arguments.ply)[:6]}", arguments.ply.absolute())
        yield from measure_model(scene, capture, arguments, flip)


def train_example(folder: Path) -> tuple[Path, Path]:
    """Draw pictures of the example scene as photos and train on them for `SHORT_ITERATIONS`.

    Returns:
        The capture and the trained file, both in `folder`.
    """
    examples = REPOSITORY / "examples"
    scene = load_gaussians(examples / "plush-toys.ply")
    assert isinstance(scene, GaussianScene)
    capture = folder / "capture"
    images: list[Record] = []
    (capture / "images").mkdir(parents=True)
    for split, name in (("train", "cameras"), ("test", "views")):
        for camera in load_cameras(examples / f"plush-toys.{name}.json"):
            small = camera.scale(64 / camera.width)
            file = f"{split}-{len(images)}.png"
            write_png(capture / "images" / file, render(scene, small))
            pose = {"fx": small.fx, "fy": small.fy, "cx": small.cx, "cy": small.cy, "W": small.width, "H": small.height}
            matrix = small.world_to_camera.tolist()
            images.append({"name": file, "split": split, **pose, "world_to_camera": matrix})
    (capture / "cameras.json").write_text(json.dumps({"images": images}), encoding="utf-8")
    target = folder / "trained.scar"
    target.write_bytes(train(capture, TrainOptions(iterations=SHORT_ITERATIONS)).data)
    return capture, target


# Tables


def make_tables(results: dict[str, dict[str, Record]]) -> str:
    """A table of everything that was measured on the photos of each scene, and bytes at equal PSNR."""
    return "\n".join(_scene_tables(name, list(records.values())) for name, records in results.items())


def _scene_tables(name: str, records: Sequence[Record]) -> str:
    """One row a file: its first layer, all of it, and each layer's share of the post-hoc bytes at its PSNR."""
    width, height = records[0]["size"]
    text = f"**{name}**: {records[0]['photos']} photos of {width}×{height} held out.\n\n"
    hull = find_frontier(_point(it) for it in records if it["kind"] == "post-hoc")
    lines = []
    for kind in SHOWN:
        for file in dict.fromkeys(it["name"] for it in records if it["kind"] == kind):
            layers = sorted((it for it in records if it["name"] == file), key=lambda it: int(it["layers"]))
            first = Figures(**layers[0]["figures"]).cells()[:2] if len(layers) > 1 else ["", ""]
            shares = _shares(layers, hull) if kind == "trained" else ""
            lines.append([_title(layers[0]), *first, *Figures(**layers[-1]["figures"]).cells(), shares])
    head = ("file", "layer 1, kB", "dB", *HEAD, "of post-hoc bytes, by layer")
    kept = [k for k in range(len(head)) if any(line[k] not in ("–", "") for line in lines)]
    return text + table([head[k] for k in kept], [[line[k] for k in kept] for line in lines])


def _shares(layers: Sequence[Record], hull: Sequence[Point]) -> str:
    """Bytes of each layer over those of the post-hoc frontier at its PSNR; – where that does not reach."""
    found = []
    for decibels, size in map(_point, layers):
        other = bytes_at(hull, decibels)
        found.append("–" if other is None else f"{100 * size / other:.0f}")
    return f"{' / '.join(found)} %" if set(found) != {"–"} else ""


def _title(record: Record) -> str:
    after = f", {record['iterations']:,} iterations" if record["iterations"] else ""
    return f"{record['name']}{after}"


def find_frontier(points: Iterable[Point]) -> list[Point]:
    """The lower convex hull of points over the logarithm of bytes, from the fewest bytes to the most dB."""
    least = dict(sorted(points, key=lambda point: point[1], reverse=True))
    hull: list[Point] = []
    for point in sorted(least.items()):
        while len(hull) > 1 and _turn(hull[-2], hull[-1], point) <= 0:
            hull.pop()
        hull.append(point)
    cheapest = min(range(len(hull)), key=lambda k: (hull[k][1], -hull[k][0]), default=0)
    return hull[cheapest:]


def _turn(a: Point, b: Point, c: Point) -> float:
    """Above 0 where the way from a over b to c bends upwards."""
    return (b[0] - a[0]) * math.log(c[1] / b[1]) - math.log(b[1] / a[1]) * (c[0] - b[0])


def _point(record: Record) -> Point:
    return record["figures"]["psnr_db"], record["figures"]["file_bytes"]


# The command


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", help="name of the capture on the page")
    parser.add_argument("capture", nargs="?", type=Path, help="capture as for `scarfmt train`, with photos held out")
    parser.add_argument("--resolution", type=int, help="longest side of the photos, pixels")
    parser.add_argument("--scar", nargs="+", default=[], metavar="[NAME=]FILE", help="trained files")
    parser.add_argument("--model", nargs="+", default=[], metavar="[NAME=]FILE", help="files trained without rate")
    parser.add_argument("--post-hoc", nargs="+", default=[], metavar="[NAME=]FILE", help="files encoded from these")
    parser.add_argument("--ply", type=Path, help="a 3DGS model of the same photos, as INRIA's PLY")
    parser.add_argument("--qualities", nargs="*", type=float, default=QUALITIES, help="qualities to encode it at, dB")
    parser.add_argument("--picture", type=Path, help="only draw the layers of the first --scar beside a photo")
    parser.add_argument("--photo", type=int, default=0, help="number of that photo among those held out")
    parser.add_argument("--short", action="store_true", help="train on pictures of the example scene")
    parser.add_argument("--report", action="store_true", help="only rewrite the tables")
    parser.add_argument("--no-write", action="store_true", help="print the table; JSON goes to build/bench/ only")
    return parser


def main(words: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = _parser()
    arguments = parser.parse_args(words)
    keep = not arguments.no_write
    results = provenance.figures(load_document(NAME)) if keep or arguments.report else {}
    with TemporaryDirectory() as folder:
        if arguments.short:
            arguments.scene = "example"
            arguments.capture, trained = train_example(Path(folder))
            arguments.scar = [f"{SHORT_ITERATIONS} iterations={trained}"]
        if not arguments.report:
            if arguments.scene is None or arguments.capture is None:
                parser.error("a scene's name and its capture are needed")
            capture = load_capture(arguments.capture, arguments.resolution)
            if not capture.test:
                parser.error(f"{arguments.capture}: no photo is held out")
            if arguments.picture is not None:
                data = Path(arguments.scar[0].rpartition("=")[2]).read_bytes()
                draw_side_by_side(data, capture.test[arguments.photo], 1600).save(arguments.picture, quality=88)
                return
            camera = capture.test[0].camera
            photos = {"photos": len(capture.test), "size": [camera.width, camera.height]}
            for record in measure_all(arguments, capture, load_flip()):
                key, found = f"{record['name']}, layer {record['layers']}", record["figures"]
                _add(results, arguments.scene, {**record, **photos}, key)
                save_results(NAME, results, keep, [f"{arguments.scene}/{key}"])
                shown = f"{found['file_bytes']:,} bytes, {found['psnr_db']:.2f} dB"
                print(f"{arguments.scene}: {key}, {shown}", file=sys.stderr, flush=True)
    if keep:
        replace_section(NAME, add_provenance(make_tables(results), NAME), RESULTS_PAGE)
    else:
        print(make_tables(results))


def _add(results: dict[str, dict[str, Record]], scene: str, record: Record, key: str) -> None:
    """Add a record; earlier ones of photos of another number or size are dropped."""
    same = ("photos", "size")
    before = {name: it for name, it in results.get(scene, {}).items() if all(it[k] == record[k] for k in same)}
    results[scene] = {**before, key: record}


if __name__ == "__main__":
    main()
