"""The smallest file of a trained scene: static tables alone, or networks where they save more than they take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from reference_encoder.training.index_entropy import JointIndexModel
from reference_encoder.training.networks.choose_predictors import choose_predictors
from reference_encoder.training.options import Stop, never
from reference_encoder.tuning import CONTEXT
from scarfmt.coding.reader import SceneReader
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.directory import local_bits
from scarfmt.container.source import BytesSource
from scarfmt.errors import LimitExceeded
from scarfmt.limits import DEFAULT_LIMITS, FORMAT_LIMITS, Limits
from scarfmt.tools.truncate import truncate


def nowhere(_data: bytes) -> None:
    """Keep nothing."""


def smallest_file(
    scene: QuantisedScene, joint: JointIndexModel | None, keep: Callable[[bytes], None] = nowhere, stop: Stop = never
) -> bytes:
    """The file of fewest bytes that readers take, of up to three: with tables alone, predictors, an index network.

    Args:
        scene: under static tables.
        joint: codes the indices of codewords; None where there are none. The paper's stays in the file, whatever it
            takes.
        keep: called with the first of them as soon as it is there.
        stop: asked again and again whether to train no more predictors.
    """
    static = write_scene(scene)
    keep(static)
    predicted = with_predictors(scene, stop=stop)
    coded = None if joint is None else joint.finish(scene if predicted is None else predicted)
    if joint is not None and joint.paper and coded is not None:
        return write_scene(coded)
    others = [write_scene(other) for other in (predicted, coded) if other is not None]
    return min((static, *filter(within_limits, others)), key=len)


def with_predictors(scene: QuantisedScene, stop: Stop = never) -> QuantisedScene | None:
    """The scene with a predictor for every step of every component where one pays; None if none does.

    Args:
        stop: asked again and again whether to train no more of them.
    """
    model = replace(scene.model, context=CONTEXT)
    bits = [local_bits(scene.fields, tile) for tile in scene.tiles]
    predictors = choose_predictors(model, scene.contents, bits, stop=stop)
    return replace(scene, model=model, predictors=predictors) if predictors else None


def within_limits(data: bytes, limits: Limits = DEFAULT_LIMITS) -> bool:
    """Whether readers of these limits take a file, and all that truncation makes of it (SPEC R-13.2-2)."""
    source = BytesSource(data)
    try:
        for layer in range(1, SceneReader(source, limits=FORMAT_LIMITS).header.layer_count + 1):
            SceneReader(BytesSource(truncate(source, layer)), limits=limits).models()
    except LimitExceeded:
        return False
    return True
