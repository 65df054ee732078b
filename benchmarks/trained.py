"""The results of photos in one table: trained files, and a 3DGS model of the same photos in several formats.

    python -m benchmarks.trained plush-on-bed CAPTURE --scar "an hour=plush.scar" --ply plush-on-bed.ply
    python -m benchmarks.trained truck-half CAPTURE --scar truck.scar --lpips vgg16.pth heads.pth
    python -m benchmarks.trained plush-on-bed CAPTURE --ply plush-on-bed.ply --formats sog --qualities 41
    python -m benchmarks.trained truck-half CAPTURE --model whole.scar --post-hoc "quality 38=encoded.scar"
    python -m benchmarks.trained --report                   only rewrite docs/trained.md

Everything is decoded and measured alike, against the photos that were held out (`benchmarks.photos`). The PLY is
measured as it is, as SOG and SPZ (`benchmarks.rivals_formats`: needs node and npm), and layer by layer as the `.scar`
that `scarfmt encode` makes of it, which knows the cameras of the photos learnt from. Results are merged into
benchmarks/results/trained.json by scene and file; those of photos of another size are dropped.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks import provenance
from benchmarks.encoded import file_key, kept_path
from benchmarks.photos import Figures, Metrics, add_arguments, figures, measured, metrics
from benchmarks.report import load_document, save_results
from benchmarks.rivals_formats import formats, read
from benchmarks.rivals_run import written
from benchmarks.rivals_tools import ToolFailed, install
from benchmarks.scenes import Scene
from benchmarks.trained_tables import SCENES, scene_tables, write_scenes
from reference_encoder.options import EncodeOptions
from reference_encoder.training.capture import Capture, load_capture
from scarfmt.api import encode, inspect
from scarfmt.atomic import atomic_write
from scarfmt.formats import load
from scarfmt.formats.clean import clean
from scarfmt.scene.gaussians import GaussianScene

QUALITIES = (41.0, 47.0)
FORMATS = ("sog", "spz")

Record = dict[str, Any]


@dataclass(frozen=True)
class Row:
    """A file that was measured.

    Attributes:
        name: how it was made.
        kind: one of `trained_tables.KINDS`.
        layers: of the file, from the first; 1 for those without.
        iterations: of its training, None where the file does not say.
        figures: of the file cut there.
    """

    name: str
    kind: str
    layers: int
    iterations: int | None
    figures: Figures

    @property
    def key(self) -> str:
        """The name among the results of the scene."""
        return f"{self.name}, layer {self.layers}"


def of_scar(name: str, kind: str, data: bytes, capture: Capture, perceptual: Metrics) -> Iterator[Row]:
    """A row of each layer of a `.scar`."""
    training = (inspect(data, metadata=True).get("metadata") or {}).get("training") or {}
    for layers, found in enumerate(figures(data, capture.test, perceptual), 1):
        yield Row(name, kind, layers, training.get("iterations"), found)


def encoded(scene: Scene, capture: Capture, quality: float) -> bytes:
    """The `.scar` that `scarfmt encode` makes of a model; kept until encoder, model or photos change."""
    kept = kept_path(scene, f"q{quality:g}-photos-{capture.digest[:12]}")
    if not kept.exists():
        options = EncodeOptions(quality=quality, cameras=[photo.camera for photo in capture.train])
        with atomic_write(kept) as stream:
            stream.write(encode(scene.path, options))
    return kept.read_bytes()


def of_model(scene: Scene, capture: Capture, said: argparse.Namespace, perceptual: Metrics) -> Iterator[Row]:
    """Rows of a model that is there as PLY: itself, in other formats, and encoded."""
    model, _ = clean(load(scene.path), drop_invalid=True)
    assert isinstance(model, GaussianScene)
    own = measured(model, scene.path.stat().st_size, capture.test, perceptual)
    yield Row("3DGS, .ply", "rival", 1, None, own)
    missing = install() if said.formats else None
    for rival in formats(model, few=True):
        if rival.family not in said.formats:
            continue
        try:
            if missing:
                raise ToolFailed(missing)
            path, _ = written(scene, scene.path, rival, fresh=False)
        except ToolFailed as error:
            print(f"skipped {rival.name}: {error}", file=sys.stderr)
            continue
        stored, _ = clean(read(path, rival.scale), drop_invalid=True)
        found = measured(stored, path.stat().st_size, capture.test, perceptual)
        yield Row(f"3DGS, {rival.name}", "rival", 1, None, found)
    for quality in said.qualities:
        data = encoded(scene, capture, quality)
        yield from of_scar(f"3DGS, `encode --quality {quality:g}`", "post-hoc", data, capture, perceptual)


def record(row: Row, capture: Capture) -> Record:
    """The record in the results."""
    camera = capture.test[0].camera
    return {**asdict(row), "photos": len(capture.test), "size": [camera.width, camera.height]}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", nargs="?", help="name of the capture on the page")
    parser.add_argument("capture", nargs="?", type=Path, help="capture as for `scarfmt train`, with photos held out")
    add_arguments(parser)
    parser.add_argument("--scar", nargs="+", default=[], metavar="[NAME=]FILE", help="trained files")
    parser.add_argument("--model", nargs="+", default=[], metavar="[NAME=]FILE", help="files trained without rate")
    parser.add_argument("--post-hoc", nargs="+", default=[], metavar="[NAME=]FILE", help="files encoded from these")
    parser.add_argument("--ply", type=Path, help="a 3DGS model of the same photos, as INRIA's PLY")
    parser.add_argument("--formats", nargs="*", choices=FORMATS, default=FORMATS, help="formats to store the PLY in")
    parser.add_argument("--qualities", nargs="*", type=float, default=QUALITIES, help="qualities to encode it at, dB")
    parser.add_argument("--report", action="store_true", help="only rewrite docs/trained.md")
    parser.add_argument("--no-write", action="store_true", help="print the table; JSON goes to build/bench/ only")
    return parser


def rows(said: argparse.Namespace, capture: Capture, perceptual: Metrics) -> Iterator[Row]:
    """All that was asked for."""
    for kind, words in (("trained", said.scar), ("model", said.model), ("post-hoc", said.post_hoc)):
        for word in words:
            name, _, path = word.rpartition("=")
            yield from of_scar(name or Path(path).stem, kind, Path(path).read_bytes(), capture, perceptual)
    if said.ply is not None:
        scene = Scene(f"{said.scene}-{file_key(said.ply)[:6]}", said.ply.absolute())
        yield from of_model(scene, capture, said, perceptual)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = _parser()
    said = parser.parse_args(arguments)
    keep = not said.no_write
    results = provenance.figures(load_document(SCENES, keep))
    if said.report:
        write_scenes(results)
        return
    if said.scene is None or said.capture is None:
        parser.error("a scene's name and its capture are needed")
    capture = load_capture(said.capture, said.resolution)
    if not capture.test:
        parser.error(f"{said.capture}: no photo is held out")
    for row in rows(said, capture, metrics(said.lpips)):
        made = record(row, capture)
        found = f"{row.figures.file_bytes:,} bytes, {row.figures.psnr_db:.2f} dB"
        print(f"{said.scene}: {row.key}, {found}", file=sys.stderr, flush=True)
        same = ("photos", "size")
        before = {key: it for key, it in results.get(said.scene, {}).items() if all(it[k] == made[k] for k in same)}
        results[said.scene] = {**before, row.key: made}
        save_results(SCENES, results, keep, [f"{said.scene}/{row.key}"])
    if keep:
        write_scenes(results)
    else:
        print(scene_tables(results))


if __name__ == "__main__":
    main()
