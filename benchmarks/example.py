"""The example scene, encoded: bytes, and PSNR from views that the encoder was not given.

    python -m benchmarks.example               rewrites benchmarks/results/example.json and examples/README.md
    python -m benchmarks.example --no-write    prints only

The tests hold later encoders to these figures: 10 % more bytes or 0.5 dB less fails. They are rewritten where a change
costs something on purpose, and the reason belongs into the commit that does.
"""

from __future__ import annotations

import argparse
from functools import partial
from statistics import fmean
from typing import Any

from benchmarks.report import add_arguments, dated, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY
from reference_decoder.decode import decode
from reference_encoder.encode import EncodeOptions, encode
from scarfmt.container.source import BytesSource
from scarfmt.formats import load
from scarfmt.render.camera import Camera
from scarfmt.render.capture import load_cameras
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.tools.inspection import inspect

NAME = "example"
EXAMPLES = REPOSITORY / "examples"
PAGE = EXAMPLES / "README.md"
QUALITY = 41.0
EFFORTS = (1, 2)


def measure(effort: int) -> dict[str, Any]:
    """Encode the example scene at `QUALITY` and look at what is decoded.

    Returns:
        ``bytes`` of the file and ``first_layer_bytes`` up to the end of its first layer; ``mean_psnr_db`` and
        ``worst_psnr_db`` of the views of examples/plush-toys.views.json; ``first_layer_psnr_db``, their mean for
        layer 1.
    """
    source = load(EXAMPLES / "plush-toys.ply")
    assert isinstance(source, GaussianScene)
    known, views = (load_cameras(EXAMPLES / f"plush-toys.{name}.json") for name in ("cameras", "views"))
    data = encode(source, EncodeOptions(quality=QUALITY, effort=effort, cameras=known))
    expected = [render(source, view) for view in views]
    first, last = (_psnr(data, views, expected, layers) for layers in (1, None))
    return {
        "bytes": len(data),
        "first_layer_bytes": inspect(BytesSource(data))["layers"][0]["end_offset"],
        "mean_psnr_db": round(fmean(last), 3),
        "worst_psnr_db": round(min(last), 3),
        "first_layer_psnr_db": round(fmean(first), 3),
    }


def _psnr(data: bytes, views: list[Camera], expected: list[Any], layers: int | None) -> list[float]:
    """PSNR of every view against the source's picture, dB."""
    scene = decode(data, layers=layers).scene
    assert isinstance(scene, GaussianScene)
    return [psnr(picture, render(scene, view)) for picture, view in zip(expected, views, strict=True)]


def markdown(results: dict[str, Any]) -> str:
    """The table of the page."""
    head = ["effort", "bytes", "first layer, bytes", "its mean PSNR dB", "mean PSNR dB", "worst view dB"]
    rows = [
        [
            name.removeprefix("effort "),
            f"{found['bytes']:,}",
            f"{found['first_layer_bytes']:,}",
            *(f"{found[field]:.2f}" for field in ("first_layer_psnr_db", "mean_psnr_db", "worst_psnr_db")),
        ]
        for name, found in results.items()
    ]
    return table(head, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser, scenes=False)
    arguments = parser.parse_args()
    keep = not arguments.no_write
    results = {f"effort {effort}": measure(effort) for effort in EFFORTS[: 1 if arguments.short else None]}
    save_results(NAME, results, keep)
    show = partial(replace_section, NAME, page=PAGE) if keep else print
    show(dated(markdown(results), NAME, keep))


if __name__ == "__main__":
    main()
