"""The vectors that a decoder must accept: the worked file, the scenes of the plans, and those at the edges."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import replace

from conformance.scenes.cases import Case
from conformance.scenes.made import build, static_plans, worked_scene
from conformance.scenes.neural_scenes import neural_plans
from conformance.scenes.page_scenes import paged_cases
from conformance.scenes.streaming_scenes import streaming_file, streaming_scene
from conformance.writer.file import write_file
from conformance.writer.options import WriteOptions
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockFlag, BlockKind, RenderModel

EDGES = frozenset({
    "anchors-32-slots", "duplicates", "fifteen-classes", "full-block", "index-edge", "index-equal", "index-ladder",
    "lattice-32", "no-anchors", "one-anchor", "one-symbol", "predictors-crowd", "predictors-deep", "predictors-edge",
    "predictors-wide", "sixteen-layers", "twenty-steps", "wide-values",
})
"""Plans whose vectors are at an end of what SPEC.md allows."""

_PICTURE = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mNoAAAAggCB2kUIOwAAAABJRU5ErkJggg=="
)
"""A PNG of one grey pixel."""
_ANNOTATIONS = (
    Block(int(BlockKind.THUMBNAIL), 1, _PICTURE),
    Block(70, 1, b"unknown annotation", flags=int(BlockFlag.SAFE_TO_COPY)),
    Block(130, 1, b"private", flags=0),
    Block(200, 2, b"private", flags=0),
)


def valid_cases() -> Iterator[Case]:
    """The vectors of the classes ``valid`` and ``edge`` that are a plan, and the worked file."""
    worked = worked_scene()
    yield Case("worked", "the worked file of SPEC.md, §4.2", write_file(worked), scene=worked)
    for name, (purpose, plan) in {**static_plans(), **neural_plans()}.items():
        scene = build(plan)
        options = WriteOptions()
        if name == "annotations":
            scene = replace(scene, fields=replace(scene.fields, render_model=RenderModel.TWO_DIMENSIONAL))
            options = WriteOptions(blocks=_ANNOTATIONS)
        yield Case(vector_id(name), purpose, write_file(scene, options), scene=scene)
    yield from paged_cases()
    purpose = "STREAMING: a view, boxes of three tiles"
    yield Case("valid/streaming", purpose, streaming_file(), ("R-7.13-1",), scene=streaming_scene())


def vector_id(name: str) -> str:
    """The id of a vector of these, by its name without the class."""
    return f"{'edge' if name in EDGES else 'valid'}/{name}"
