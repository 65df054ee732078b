"""`scarfmt compare`: measures how close the pictures of two scenes are."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.failures import requires_extra
from scarfmt.cli.files import check_stdout, open_input, timeout_option
from scarfmt.cli.progress import Tell, progress
from scarfmt.cli.report import Report, reports
from scarfmt.cli.views import EVERYWHERE, LISTED, ViewOptions, list_cameras, view_options, views_of
from scarfmt.container.header import is_scar
from scarfmt.errors import InputWarning
from scarfmt.tools.inspection import inspect

if TYPE_CHECKING:
    from scarfmt.cli.scenes import SceneOrigin, Subject
    from scarfmt.render.camera import Camera
    from scarfmt.render.compare import Comparison


_MIDDLE = (0.1, 0.9)
"""Quantiles between which most Gaussians of a scene lie, on each axis."""
_ROUNDED = 0.05
"""How far a coarse file moves positions, at most, as a part of the size of its scene."""
_STATISTICS = ("mean_psnr_db", "p5_psnr_db", "worst_psnr_db", "mean_ssim", "worst_ssim")


@dataclass(frozen=True)
class Quality:
    """How close the pictures of two scenes are.

    Attributes:
        views: all views.
        kinds: the views of each kind.
    """

    views: Comparison
    kinds: dict[str, Comparison]

    def summary(self) -> dict[str, Any]:
        """Mean, 5th percentile and worst of all views; under ``kinds`` the same figures for each kind of view."""
        whole, *parts = (
            {name: getattr(views, name) for name in _STATISTICS} for views in (self.views, *self.kinds.values())
        )
        return {**whole, "kinds": dict(zip(self.kinds, parts, strict=True))}


Measure = Callable[["Subject", "Subject", Tell], Quality]
"""Quality of the second scene, in the terms that the options ask for."""


@click.command()
@click.argument("a")
@click.argument("b")
@view_options(EVERYWHERE)
@click.option("--layers-a", type=click.IntRange(min=1), help="Number of layers of A to use, if A is a .scar file.")
@click.option("--layers-b", type=click.IntRange(min=1), help="Number of layers of B to use, if B is a .scar file.")
@click.option("--all-layers", is_flag=True, help="Compare each number of layers of B, which must be a .scar file.")
@click.option("--ssim/--no-ssim", default=True, show_default=True, help="Compute SSIM, which takes as long as drawing.")
@click.option("--photos", type=click.Path(exists=True),
              help="Folder with cameras and images/. Compare A and B with these photos: those held out of training, as"
              " a trained file or else the list of cameras says.")  # fmt: skip
@timeout_option
@reports
@requires_extra("render")
def compare(
    a: str,
    b: str,
    layers_a: int | None,
    layers_b: int | None,
    all_layers: bool,
    ssim: bool,
    photos: str | None,
    **views: Any,
) -> Report:
    """Draw the scenes A and B from the same cameras and report PSNR (dB) and SSIM of B against A.

    A and B are any scene files: .scar (path or URL), PLY, SPZ, SOG, .splat or anchor models. A places the cameras, so
    all files that are compared with the same A are seen from the same places.

    \b
    Examples:
      scarfmt compare scene.ply scene.scar
      scarfmt compare scene.ply scene.scar --from inside --frame z
      scarfmt compare scene.ply scene.scar --all-layers --frame -y:125:70
      scarfmt compare scene.ply scene.spz --cameras cameras.json --json
      scarfmt compare scene.ply scene.scar --photos capture/
    """
    if all_layers and layers_b is not None:
        raise click.UsageError("--all-layers and --layers-b exclude each other")
    options = ViewOptions(**views)
    if photos is not None and (options.cameras or options.views or options.size or options.kind):
        raise click.UsageError("--photos has its own cameras: leave out --cameras, --views, --from and --size")
    from scarfmt.cli.scenes import scene_origin

    check_stdout()
    with progress() as report:
        first, second = scene_origin(a), scene_origin(b)
        measure: Measure
        if photos is None:
            measure = partial(_against, options, list_cameras(options), ssim)
        else:
            measure = partial(_with_photos, photos, _held_out(photos, (second, first)), ssim)
        if all_layers:
            rows = _compare_layers(first, layers_a, second, measure, report)
        else:
            result = _compare_pair(first, layers_a, second, layers_b, measure, photos is not None, report)
    return _layers_report(a, b, rows) if all_layers else _pair_report(a, b, result)


def _held_out(photos: str, origins: Sequence[SceneOrigin]) -> tuple[str, ...]:
    """Names of the photos that the first trained file held out; none where the list of cameras marks them or nobody
    does, which is told."""
    from scarfmt.render.capture import load_cameras

    for origin in origins:
        names = _training(origin).get("held_out")
        if isinstance(names, list) and names:
            return tuple(map(str, names))
    if not any(camera.split for camera in load_cameras(photos)):
        message = "nobody says which photos were held out: all are compared, also those that a scene was trained on"
        warnings.warn(message, InputWarning, stacklevel=2)
    return ()


def _training(origin: SceneOrigin) -> dict[str, Any]:
    """What the METADATA of a .scar file say about its training; empty where they say nothing."""
    if not is_scar(origin):
        return {}
    with open_input(origin) as source:
        metadata = inspect(source, metadata=True)["metadata"] or {}
    training = metadata.get("training")
    return training if isinstance(training, dict) else {}


def _compare_pair(
    a: SceneOrigin,
    layers_a: int | None,
    b: SceneOrigin,
    layers_b: int | None,
    measure: Measure,
    both: bool,
    report: Tell,
) -> dict[str, Quality]:
    """Quality of B against A under ``b``; with photos, quality of each scene against them under ``a`` and ``b``."""
    from scarfmt.cli.scenes import load_subject

    first = load_subject(a, layers_a)
    second = load_subject(b, layers_b).beside(first)
    _warn_if_apart(first, second)
    subjects = {"a": first, "b": second} if both else {"b": second}
    return {name: measure(first, subject, report) for name, subject in subjects.items()}


def _warn_if_apart(first: Subject, second: Subject) -> None:
    """Say that scenes do not meet: their formats may have lost an origin, or have axes of other signs."""
    import numpy as np

    (low_a, high_a), (low_b, high_b) = (np.quantile(s.placed.positions, _MIDDLE, axis=0) for s in (first, second))
    gap, size = np.maximum(low_a - high_b, low_b - high_a).max(), max((high_a - low_a).max(), (high_b - low_b).max())
    # Rounding of positions alone parts what is flat; of two points nothing can be said.
    if size and gap > _ROUNDED * size:
        message = "the scenes lie apart, so that these figures tell nothing: was an origin left out, or an axis turned?"
        warnings.warn(message, InputWarning, stacklevel=2)


def _against(
    options: ViewOptions, listed: list[Camera] | None, ssim: bool, first: Subject, second: Subject, report: Tell
) -> Quality:
    """Quality of the second scene against the first, from the cameras that are listed or placed around the first."""
    from scarfmt.render.compare import compare

    kinds = {LISTED: listed} if listed else views_of(first.placed, options, EVERYWHERE)
    cameras = [camera for views in kinds.values() for camera in views]
    found = compare(first.view, second.reporting(report, len(cameras)).view, cameras, ssim)
    parts, first_view = {}, 0
    for kind, views in kinds.items():
        parts[kind] = found.part(first_view, len(views))
        first_view += len(views)
    return Quality(found, parts)


def _with_photos(
    photos: str, held_out: tuple[str, ...], ssim: bool, _first: Subject, second: Subject, _report: Tell
) -> Quality:
    """Quality of the second scene against the photos of a folder that were held out of training."""
    from scarfmt.render.compare import compare_with_photos

    found = compare_with_photos(second.view, photos, ssim=ssim, names=held_out)
    return Quality(found, {"photos": found})


def _compare_layers(
    a: SceneOrigin, layers_a: int | None, b: SceneOrigin, measure: Measure, report: Tell
) -> list[dict[str, Any]]:
    """One row for each complete layer of B: its number, bytes, bytes per Gaussian, PSNR and SSIM."""
    from scarfmt.cli.scenes import layer_table, load_subject

    first = load_subject(a, layers_a).remembering()
    rows = []
    table = layer_table(b)
    for layer in table:
        report(f"layer {layer['layer']}", (layer["layer"] - 1) / len(table))
        second = load_subject(b, layer["layer"]).beside(first)
        quiet: Tell = lambda _stage, _part: None  # noqa: E731
        result = measure(first, second, quiet)
        rows.append(
            {
                "layer": layer["layer"],
                "bytes": layer["end_offset"],
                "bytes_per_source": layer["bytes_per_source"],
                "bytes_per_anchor": layer["bytes_per_anchor"],
                **result.summary(),
            }
        )
    return rows


def _pair_report(a: str, b: str, results: dict[str, Quality]) -> Report:
    document = {"a": a, "b": b, "results": {name: {**asdict(it.views), **it.summary()} for name, it in results.items()}}
    lines = []
    for name, result in results.items():
        lines.append(f"{b} against {a}" if len(results) == 1 else f"{a if name == 'a' else b} against the photos")
        views = result.views
        width = max(len("worst"), *map(len, views.names))
        similarities: tuple[float | None, ...] = views.ssim or (None,) * len(views.names)
        for view in zip(views.names, views.psnr_db, similarities, strict=True):
            lines.append(_row(view[0], width, *view[1:]))
        if len(result.kinds) > 1:
            for kind, part in result.kinds.items():
                lines += _summary(f"of {kind}:", part, width)
        lines += _summary("of all views:", views, width)
    return Report(document, "\n".join(lines), table=True)


def _summary(title: str, views: Comparison, width: int) -> list[str]:
    has_ssim = bool(views.ssim)
    return [
        title,
        _row("mean", width, views.mean_psnr_db, views.mean_ssim if has_ssim else None),
        _row("5 %", width, views.p5_psnr_db, None),
        _row("worst", width, views.worst_psnr_db, views.worst_ssim if has_ssim else None),
    ]


def _row(name: str, width: int, decibels: float, similarity: float | None) -> str:
    end = "" if similarity is None else f"  {similarity:7.4f} SSIM"
    return f"  {name:<{width}}  {_decibels(decibels)}{end}"


def _decibels(value: float) -> str:
    return f"{value:7.2f} dB" if value < math.inf else f"{'equal':>10}"


def _layers_report(a: str, b: str, rows: list[dict[str, Any]]) -> Report:
    lines = ["layer         bytes  bytes/Gaussian  PSNR mean        5 %      worst    SSIM"]
    for row in rows:
        line = f"{row['layer']:>5}  {row['bytes']:>12,}  {row['bytes_per_source']:>14.2f}"
        decibels = " ".join(_decibels(row[f"{name}_psnr_db"]) for name in ("mean", "p5", "worst"))
        lines.append(f"{line}  {decibels}  {row['mean_ssim']:>6.4f}")
    return Report({"a": a, "b": b, "layers": rows}, "\n".join(lines), table=True)
