"""Trained scenes that commands read: the list of formats, and how a scene is read."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from scarfmt.cli.files import read_origin

if TYPE_CHECKING:
    from scarfmt.scene.gaussians import AnchorModel, GaussianScene

FORMAT_IDS = ("compressed-ply", "scaffold", "ply", "spz", "gltf", "streamed-sog", "sog", "anchor-npz", "splat")


def read_scene(
    name: str, format_id: str | None, sh_degree: int | None, drop_invalid: bool, quiet: bool
) -> GaussianScene | AnchorModel:
    """A scene that can be encoded, cleaned and cut to `sh_degree`; what was left out is reported on stderr.

    Raises:
        click.UsageError: `sh_degree` for an anchor model.
        ScarError: the scene is refused.
    """
    from scarfmt.formats import MAX_PIPE_BYTES, load
    from scarfmt.formats.clean import clean
    from scarfmt.scene.gaussians import GaussianScene

    scene, dropped = clean(load(read_origin(name, MAX_PIPE_BYTES), format=format_id), drop_invalid)
    if dropped and not quiet:
        click.echo(f"left out {dropped:,} Gaussians with NaN or infinite values", err=True)
    if sh_degree is None:
        return scene
    if not isinstance(scene, GaussianScene):
        raise click.UsageError("--sh-degree does not apply to an anchor model")
    return scene.with_sh_degree(min(sh_degree, scene.sh_degree))
