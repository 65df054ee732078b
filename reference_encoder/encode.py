"""Encoding: from a scene to the bytes of a `.scar` file (encoder side; nothing here is normative).

    stage                 makes           what is decided                                   in
    profile.measure       Profile         nothing: what an error in each value shows        importance, profiles
    profile.prepare       RdoInput        at one lambda: classes, tiles, cells, latent      profiles, rdo
    measure_curves        RdCurve         nothing: what each step of each class costs       rdo/curves.py
    Encoder.trial         Trial           layers, steps, contexts, all integers             rdo/layers.py, allocation.py
    Encoder.run           Trial           lambda, until pictures are as good as asked;      judge
                                          then layers, by pictures
    encode                Encoded         nothing: the bytes, and how good they look        streaming_block.py

One currency runs through all of it: lambda, squared picture error per bit.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from reference_encoder.importance.view_sampling import ViewSet
from reference_encoder.judge.quality import Judge, Quality
from reference_encoder.judge.rate_control import converge
from reference_encoder.judge.reconstruct import PreviewScene
from reference_encoder.opening_view import find_opening_view, thumbnail_blocks
from reference_encoder.options import EncodeOptions
from reference_encoder.profiles.anchors import AnchorProfile
from reference_encoder.profiles.explicit import ExplicitProfile
from reference_encoder.profiles.profile import Profile
from reference_encoder.rdo.allocation import allocate
from reference_encoder.rdo.curves import RdCurve, measure_curves
from reference_encoder.rdo.lattice import check_crowd, find_far
from reference_encoder.rdo.layers import (
    LayeredInput,
    PreviewMetric,
    Steps,
    find_first_layer,
    find_later_layers,
    layer_by_rule,
    price_layers,
    split_classes,
)
from reference_encoder.rdo.rdo_input import RdoInput
from reference_encoder.streaming_block import build_streaming_block
from reference_encoder.tuning import FIRST_CAP_DB, FIRST_VIEWS, LATER_VIEWS
from scarfmt.coding.writer import QuantisedScene, Report, assemble_file, code_blocks, silent
from scarfmt.errors import InvalidInput, LossWarning, plural
from scarfmt.limits import MAX_ANCHORS_PER_TILE
from scarfmt.render.camera import warn_if_cameras_miss_scene
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

__all__ = ["EncodeOptions", "Encoded", "encode"]


class Encoded(bytes):
    """The bytes of a file, and how good its pictures are.

    Attributes:
        quality: of the last layer, from views that played no part in encoding.
    """

    quality: Quality

    def __repr__(self) -> str:
        return f"<Encoded: {len(self):,} bytes; {self.quality.verdict()}>"


def encode(
    scene: GaussianScene | AnchorModel, options: EncodeOptions | None = None, report: Report = silent
) -> Encoded:
    """The bytes of a file for `scene`: the same for the same scene, options, packages and BLAS kernel.

    Args:
        scene: without NaN or infinity (see `scarfmt.formats.clean`), at least one Gaussian or anchor.
        options: None for the defaults.
        report: receives (one of `STAGES`, fraction of it that is done).

    Raises:
        InvalidInput: ``input-empty``, ``input-options``, ``input-anchors``, ``input-crowded``.

    Warns:
        InputWarning: the cameras given do not look at the scene, or without them half of it is too small to see.
        LossWarning: Gaussians are left out that lie beyond all reach of the rest.
    """
    options = options or EncodeOptions()
    if len(scene) == 0:
        raise InvalidInput("input-empty", "the scene holds no Gaussian: there is nothing to encode")
    positions = scene.positions if isinstance(scene, GaussianScene) else scene.anchors
    check_crowd(positions, MAX_ANCHORS_PER_TILE * min(options.layers, 2))
    if isinstance(scene, GaussianScene):
        scene = _without_far(scene)
    if options.cameras:
        warn_if_cameras_miss_scene(positions, options.cameras)
    profile = measure_scene(scene, options, report)
    quantised = Encoder(profile).run().scene
    drawn = profile.reconstruct(quantised)
    report("quality", 0.0)
    judge = profile.judge(ViewSet.HELD_OUT)
    quality, opening = judge.quality(drawn), find_opening_view(drawn, profile.options)
    streaming = build_streaming_block(quantised, drawn, opening)
    quantised = replace(quantised, metadata={"quality": quality.figures(), **quantised.metadata}, streaming=streaming)
    blocks = code_blocks(quantised, report)
    blocks += thumbnail_blocks(judge.view(drawn), opening, sum(len(block.payload) for block in blocks))
    encoded = Encoded(assemble_file(quantised, blocks))
    encoded.quality = quality
    return encoded


def _without_far(scene: GaussianScene) -> GaussianScene:
    far = find_far(scene.positions)
    if not len(far):
        return scene
    place = ", ".join(f"{value:g}" for value in scene.positions[far[0]])
    said = f"{len(far)} of {plural(len(scene), 'Gaussian')} left out, so far away that the others would share one place"
    warnings.warn(f"{said}: the first at ({place})", LossWarning, stacklevel=3)
    return scene.take(np.delete(np.arange(len(scene)), far))


def measure_scene(scene: GaussianScene | AnchorModel, options: EncodeOptions, report: Report = silent) -> Profile[Any]:
    """The scene, and what an error in each of its values shows."""
    if isinstance(scene, AnchorModel):
        return AnchorProfile.measure(scene, options, report)
    return ExplicitProfile.measure(scene, options, report)


@dataclass(frozen=True)
class Trial:
    """The result at one lambda.

    Attributes:
        profile: the scene.
        layered: what was decided.
    """

    profile: Profile[Any]
    layered: LayeredInput

    @cached_property
    def scene(self) -> QuantisedScene:
        """All integers of the file, computed when they are first wanted."""
        problem = self.layered.problem
        return self.profile.quantise(problem, allocate(problem, self.layered.curves, self.layered.choices))


@dataclass
class Encoder:
    """The stages after measuring, repeated until pictures are as good as asked.

    Attributes:
        profile: the scene.
        trials: so far.
    """

    profile: Profile[Any]
    trials: int = 0

    def run(self) -> Trial:
        """The trial that is as good as asked, layers in place."""
        trial = converge(self.profile.options, self.trial, self._psnr_db)
        if not self._previews:
            return trial
        problem, curves = trial.layered.problem, trial.layered.curves
        del trial  # its integers are as large as the scene
        return Trial(self.profile, self._layer_by_pictures(problem, curves))

    def trial(self, target: float) -> Trial:
        """The decision for a target, dB: layers by rule, or one that pictures will divide."""
        problem, layers = self.profile.prepare(target), self.profile.options.layers
        self._report()
        self.trials += 1
        curves = measure_curves(problem)
        return Trial(self.profile, layer_by_rule(problem, curves, 1 if self._previews else layers))

    @property
    def _previews(self) -> bool:
        """Whether pictures decide what layers hold."""
        options = self.profile.options
        return options.layers > 1 and bool(options.effort) and self.profile.previews

    def _layer_by_pictures(self, problem: RdoInput, curves: Sequence[RdCurve]) -> LayeredInput:
        """The content of layers, chosen from pictures: a first layer without holes, then others.

        Args:
            problem, curves: no class is split.
        """
        asked, layers = self.profile.options.asked_db, self.profile.options.layers
        costs = price_layers(problem, curves)
        metric = self._metric(problem, curves, FIRST_VIEWS, FIRST_CAP_DB)
        first = find_first_layer(costs, metric, asked, problem.base_share)
        del metric  # a metric holds a copy of all values
        problem, curves = split_classes(problem, curves, first.parts)
        metric = self._metric(problem, curves, LATER_VIEWS, asked)
        choices = find_later_layers(price_layers(problem, curves), metric, first.without_parts, layers)
        return LayeredInput(problem, curves, choices, first)

    def _metric(self, problem: RdoInput, curves: Sequence[RdCurve], views: int, most: float) -> PreviewMetric:
        """How good layers look from at least so many `views` of each kind, each counting as at most `most` dB."""
        scene, judge = PreviewScene.of(problem, curves), self._judge.thin(views, most)

        def decibels(steps: Sequence[Steps], parts: Sequence[float]) -> float:
            self._report()
            return judge.quality(scene.reconstruct(steps, parts)).preview_db

        return decibels

    @cached_property
    def _judge(self) -> Judge[Any]:
        """Pictures of the source, drawn when they are first wanted."""
        return self.profile.judge(ViewSet.TUNING)

    def _psnr_db(self, trial: Trial) -> float:
        self._report()
        found = self._judge.quality(self.profile.reconstruct(trial.scene))
        return found.rated_db if self.profile.options.worst is None else found.low_db

    def _report(self) -> None:
        """Report that the fit goes on. How many trials it takes is not known: each is a third of what is left."""
        self.profile.report("fit", 1 - (2 / 3) ** self.trials)
