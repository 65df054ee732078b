"""`scarfmt stream`: fetches a file in the order a view needs it, and draws the view while bytes arrive."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scarfmt.cli.eye import camera_of, eye_options, parse_point
from scarfmt.cli.failures import requires_extra
from scarfmt.cli.files import check_stdout, open_input, print_json, timeout_option

if TYPE_CHECKING:
    from scarfmt.scene.gaussians import GaussianScene
    from scarfmt.streaming.client import StreamClient
    from scarfmt.streaming.view import Camera

_EVERY = 100_000


@click.command(short_help="Fetch a file in the order a view needs it.")
@click.argument("file")
@click.argument("output", required=False, type=click.Path(file_okay=False))
@click.option("--plan", "plan_only", is_flag=True, help="Fetch nothing: print the order, with bytes and gains.")
@eye_options
@click.option("--velocity", callback=parse_point, metavar="X,Y,Z", help="Velocity of the eye, in world units a second.")
@click.option("--budget", type=click.IntRange(min=1), metavar="BYTES", help="Maximum bytes of tiles and models.")
@click.option("--splats", type=click.IntRange(min=1), metavar="N", help="Maximum number of Gaussians to show.")
@click.option("--every", type=click.IntRange(min=1), default=_EVERY, show_default=True, metavar="BYTES",
              help="Draw a picture each time this many bytes have arrived.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print JSON on stdout.")
@timeout_option
@requires_extra("render")
def stream(file: str, output: str | None, plan_only: bool, as_json: bool, every: int, **said: Any) -> None:
    """Fetch FILE (a path or a URL) in the order in which a view needs it, and draw pictures into the folder OUTPUT.

    First come the front of the file, the models, and layer 1 of all tiles in the picture. Then come the layers that
    reduce the error most for each byte. A file that was encoded with --viewpoints holds these gains; for other files
    they are estimated. Only files of plain Gaussians are drawn, not anchor models.

    \b
    Examples:
      scarfmt stream scene.scar --plan
      scarfmt stream https://example.org/scene.scar pictures/ --every 200000
      scarfmt stream scene.scar --plan --camera 0,1,4 --target 0,0,0 --up 0,1,0 --budget 1000000 --json
    """
    from scarfmt.streaming.boxes import tight_boxes
    from scarfmt.streaming.client import StreamClient
    from scarfmt.streaming.plan import affordable

    if not plan_only and output is None:
        raise click.UsageError("give OUTPUT, a folder for pictures, or --plan")
    check_stdout()
    with open_input(file) as source:
        client = StreamClient(source)
        boxes = tight_boxes(client.index.cubes, client.told)
        camera = camera_of(said, (boxes.low, boxes.high), None if client.told is None else client.told.view)
        steps = affordable(
            client.index, client.plan(camera), size=said["budget"] or math.inf, splats=said["splats"] or math.inf
        )
        if plan_only:
            _print_plan(client, camera, steps, as_json)
            return
        assert output is not None
        shown = list(_fetched(client, camera, steps, every, Path(output)))
    if as_json:
        print_json(shown)
    for row in () if as_json else shown:
        tiles = f"{row['tiles']:,} tiles, {row['gaussians']:,} Gaussians"
        click.echo(f"{row['bytes']:>12,} bytes in {row['requests']:>4} requests: {tiles}, {row['picture']}")


def _print_plan(client: StreamClient, camera: Camera, steps: Any, as_json: bool) -> None:
    from scarfmt.streaming.plan import weighed

    gains, _, share = weighed(client.index, client.told, camera, client.have)
    rows, total, models = [], client.transfer.size, 0
    for tile, layer in steps:
        more = client.index.bytes[tile, layer - 1] + client.index.model_bytes[models:layer].sum()
        total, models = total + int(more), max(models, layer)
        rows.append({"tile": tile, "layer": layer, "bytes": int(more), "total": total,
                     "gain": float(gains[tile, layer - 1]), "in_picture": float(share[tile])})  # fmt: skip
    if as_json:
        print_json({"told": client.told is not None, "front": client.transfer.size, "steps": rows})
        return
    whose = "from the file" if client.told else "estimated"
    click.echo(f"{client.transfer.size:,} bytes before models and tiles; gains {whose}")
    click.echo(f"{'step':>6}  {'tile':>6}  {'layer':>5}  {'bytes':>10}  {'total':>12}  {'gain':>9}  in picture")
    for number, row in enumerate(rows, start=1):
        click.echo(
            f"{number:>6}  {row['tile']:>6}  {row['layer']:>5}  {row['bytes']:>10,}  {row['total']:>12,}"
            f"  {row['gain']:>9.2e}  {100 * row['in_picture']:>8.0f} %"
        )


def _fetched(client: StreamClient, camera: Camera, steps: Any, every: int, folder: Path) -> Any:
    """Fetch and draw; yields for each picture the bytes, requests, tiles and Gaussians so far, and its name."""
    from scarfmt.render.camera import look_at
    from scarfmt.render.images import write_png
    from scarfmt.render.rasterise import render

    folder.mkdir(parents=True, exist_ok=True)
    horizontal = 2 * math.atan(math.tan(camera.fov_y / 2) * camera.width / camera.height)
    view = look_at(camera.position, camera.position + camera.forward, camera.up, int(camera.width), int(camera.height),
                   math.degrees(horizontal))  # fmt: skip
    left = list(steps)
    while left:
        left = left[client.fetch(left, every) :]
        scene = _scene(client)
        name = f"{client.transfer.size:012d}.png"
        write_png(folder / name, render(scene, view))
        shown = sum(k > 0 for k in client.have)
        yield {"bytes": client.transfer.size, "requests": client.transfer.requests, "tiles": shown,
               "gaussians": len(scene), "picture": name}  # fmt: skip


def _scene(client: StreamClient) -> GaussianScene:
    """The Gaussians of all tiles, each decoded to the last layer that has arrived."""
    import numpy as np

    from reference_decoder.decode import decode
    from scarfmt.errors import InvalidInput
    from scarfmt.scene.gaussians import GaussianScene

    parts = []
    for layer in range(1, max(client.have) + 1):
        tiles = [tile for tile, have in enumerate(client.have) if have == layer]
        if tiles:
            found = decode(client.copy, layers=layer, tiles=tiles).scene
            if not isinstance(found, GaussianScene):
                raise InvalidInput("input-attributes", "this file is an anchor model; only plain Gaussians are drawn")
            parts.append(found)
    names = ("positions", "log_scales", "rotations", "opacity_logits", "sh")
    return GaussianScene(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
