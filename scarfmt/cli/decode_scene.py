"""`scarfmt decode` for a scene index, and for the part of a scene that one view needs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, BinaryIO

import click

from scarfmt.cli.eye import camera_of
from scarfmt.cli.files import open_input
from scarfmt.cli.outputs import SceneOutput, report_written

if TYPE_CHECKING:
    from reference_decoder.request import DecodeRequest
    from reference_decoder.scenes.needs import LevelOfDetail
    from reference_decoder.scenes.scene_set import SceneSet
    from reference_decoder.stream_ply import Baking
    from scarfmt.blocks.streaming import View
    from scarfmt.container.source import ByteSource
    from scarfmt.counters import Counters
    from scarfmt.scene.gaussians import GaussianScene

VIEW_OPTIONS = ("camera", "target", "up", "fov", "size", "budget", "outside")
"""Options that select a view. If any of them is given, only what the view needs is decoded."""


def write_part(
    name: str,
    source: ByteSource,
    out: SceneOutput,
    request: DecodeRequest,
    view: dict[str, Any],
    baking: Baking | None,
    counters: Counters,
    quiet: bool,
) -> tuple[str, dict[str, int]]:
    """Write a scene, or the part of it that a view needs.

    Args:
        name: name of the scene, as typed.
        source: the file that was opened under this name.
        out: target and its format.
        request: what to decode.
        view: values of `VIEW_OPTIONS`.
        baking: how to bake anchor models, or None to refuse them.
        counters: receive the work that was done.
        quiet: show no progress.

    Returns:
        A sentence about what was written, and the totals of the whole scene.

    Raises:
        click.UsageError: options that do not go together.
    """
    from reference_decoder.scenes.scene_ply import export_scene_ply
    from reference_decoder.scenes.scene_set import open_scene
    from reference_decoder.scenes.stream_scene import stream_scene
    from scarfmt.cli.progress import progress
    from scarfmt.cli.stats import whole_scene
    from scarfmt.formats.output import Written
    from scarfmt.scene.streams import ATTRIBUTES

    seen = any(view.values())
    if request.names() != frozenset(ATTRIBUTES):
        raise click.UsageError("--attributes is for a whole file, not for an index or a view")
    if seen and baking is not None:
        raise click.UsageError("--bake is for all of a file, not for what a view needs")
    with open_scene(name, source=source, opener=open_input) as scene:
        detail = _detail(scene, view) if seen else None
        whole = whole_scene(scene.index)
        with progress(quiet) as report:
            how: Any = {"baking": baking, "counters": counters, "report": report}
            if out.format_id == "npz":
                written = Written(_write_npz(scene, out.target, request, detail, counters), ())
            elif out.format_id == "ply":
                written = Written(export_scene_ply(scene, out.target, request, detail, **how), ())
            else:
                stream = stream_scene(scene, request, detail, _alone, **how)
                written = out.write(stream.described, stream.parts)
        if scene.holds(source):
            counters.bytes_read, counters.reads = source.bytes_read, source.reads
    return report_written(written, quiet), whole


def _alone(scene: GaussianScene, _notes: tuple[str, ...]) -> GaussianScene:
    return scene


def _write_npz(
    scene: SceneSet, target: BinaryIO, request: DecodeRequest, view: LevelOfDetail | None, counters: Counters
) -> int:
    import numpy as np

    found = scene.decode(request, view, counters=counters)
    np.savez(target, **vars(found))
    return len(found)


def _detail(scene: SceneSet, said: dict[str, Any]) -> LevelOfDetail:
    from reference_decoder.scenes.needs import LevelOfDetail

    camera = camera_of(said, scene.boxes, _view(scene))
    return LevelOfDetail(camera, said["budget"], said["outside"])


def _view(scene: SceneSet) -> View | None:
    """The first view of a scene of one file, if the file names one."""
    from scarfmt.blocks.streaming import read_streaming
    from scarfmt.container.file import Container

    if len(scene.files) > 1 or scene.index.files[0].placement is not None:
        return None
    with scene.files.opened(0) as source:
        told = read_streaming(Container.open(source, allow_truncated=True))
    return None if told is None else told.view
