"""The vectors that a decoder must accept: the worked file, the scenes of the plans, and those at the edges."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

from conformance.scenes.cases import Case
from conformance.scenes.made import build, static_plans, worked_scene
from conformance.scenes.neural_scenes import neural_plans
from conformance.scenes.page_scenes import paged_cases
from conformance.scenes.streaming_scenes import streaming_file, streaming_scene
from conformance.surgery.files import vector_file
from scarfmt.container.file import Block
from scarfmt.container.schema import BlockFlag

EDGES = frozenset({
    "anchors-32-slots", "duplicates", "fifteen-classes", "full-block", "index-edge", "index-equal", "index-ladder",
    "lattice-32", "no-anchors", "one-anchor", "one-symbol", "predictors-crowd", "predictors-deep", "predictors-edge",
    "predictors-wide", "sixteen-layers", "twenty-steps", "wide-values",
})
"""Plans whose vectors are at an end of what SPEC.md allows."""

_STREAMING = "valid/streaming"
_ANNOTATIONS = (
    Block(70, 1, b"unknown annotation", flags=int(BlockFlag.SAFE_TO_COPY)),
    Block(130, 1, b"private", flags=0),
    Block(200, 2, b"private", flags=0),
)


def valid_cases(only: Collection[str] | None = None) -> Iterator[Case]:
    """The vectors of the classes ``valid`` and ``edge`` that are a plan, and the worked file; of ids `only`."""
    worked = worked_scene()
    yield Case("worked", "the worked file of SPEC.md, appendix B", vector_file(worked), scene=worked)
    for name, (purpose, plan) in {**static_plans(), **neural_plans()}.items():
        id_ = f"{'edge' if name in EDGES else 'valid'}/{name}"
        if only is None or id_ in only:
            scene = build(plan)
            data = vector_file(scene, _ANNOTATIONS if name == "annotations" else ())
            yield Case(id_, purpose, data, scene=scene)
    yield from (case for case in paged_cases() if only is None or case.id in only)
    if only is None or _STREAMING in only:
        purpose = "STREAMING: two viewpoints, a view, three tiles"
        yield Case(_STREAMING, purpose, streaming_file(), ("R-7.13-1",), scene=streaming_scene())


def named(cases: list[Case]) -> dict[str, Case]:
    """Cases by their name, without the class."""
    return {case.id.rpartition("/")[2]: case for case in cases}


def with_origin(case: Case, valid: dict[str, Case]) -> Case:
    """The case, its origin found in whichever class that vector is."""
    if case.origin is None:
        return case
    return replace(case, origin=valid[case.origin.rpartition("/")[2]].id)
