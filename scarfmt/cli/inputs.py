"""Trained scenes that commands read: the list of formats, and how a scene is read."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

from scarfmt.cli.files import read_origin
from scarfmt.container.registries import RenderModel

if TYPE_CHECKING:
    from scarfmt.scene.gaussians import AnchorModel, GaussianScene

FORMAT_IDS = (
    "compressed-ply",
    "scaffold",
    "ply",
    "spz",
    "streamed-sog",
    "supersplat",
    "sog",
    "gltf",
    "usd",
    "anchor-npz",
    "rad",
    "ksplat",
    "splat",
)


RENDER_MODELS = {
    "classic": RenderModel.CLASSIC,
    "antialiased": RenderModel.ANTIALIASED,
    "2dgs": RenderModel.TWO_DIMENSIONAL,
}

render_model_option = click.option(
    "--render-model",
    type=click.Choice(list(RENDER_MODELS)),
    help="How INPUT was trained to be drawn, if its file does not say: antialiased for Mip-Splatting [default: what the"
    " file says, or classic].",
)


def read_scene(
    name: str,
    format_id: str | None,
    sh_degree: int | None,
    drop_invalid: bool,
    render_model: str | None,
) -> GaussianScene | AnchorModel:
    """A scene that can be encoded, cleaned and cut to `sh_degree`; what was left out is reported on stderr.

    Raises:
        click.UsageError: `sh_degree` for an anchor model.
        ScarError: the scene is refused.
    """
    from scarfmt.formats import MAX_PIPE_BYTES, load
    from scarfmt.formats.clean import clean
    from scarfmt.scene.gaussians import GaussianScene

    scene, _ = clean(load(read_origin(name, MAX_PIPE_BYTES), format=format_id), drop_invalid)
    if render_model is not None and isinstance(scene, GaussianScene):
        described = replace(scene.description, render_model=RENDER_MODELS[render_model])
        scene = replace(scene, description=described)
    if sh_degree is None:
        return scene
    if not isinstance(scene, GaussianScene):
        raise click.UsageError("--sh-degree does not apply to an anchor model")
    return scene.with_sh_degree(min(sh_degree, scene.sh_degree))
