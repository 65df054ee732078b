"""The interface between the pipeline and a profile (encoder side)."""

from __future__ import annotations

from typing import Protocol, TypeVar

from reference_encoder.decide.assemble import Quantised
from reference_encoder.decide.decision import Decision
from reference_encoder.decide.problem import Problem
from reference_encoder.judge.judge import Judge
from reference_encoder.judge.looks import Looks
from reference_encoder.judge.views import Sight
from reference_encoder.options import EncodeOptions
from scarfmt.coding.writer import QuantisedScene, Report

S = TypeVar("S")


class Profile(Protocol[S]):
    """A scene that was measured: what errors in it show is known, and nothing is decided.

    Attributes:
        options: of the encoder.
        report: told (stage, fraction done).
        source_count: Gaussians or anchors of the source.
        shows_layers: whether layers can be drawn, and what they hold decided by that.
        looks: pictures of the source to judge layers by; None where they cannot be drawn.
    """

    @property
    def options(self) -> EncodeOptions: ...
    @property
    def report(self) -> Report: ...
    @property
    def source_count(self) -> int: ...
    @property
    def shows_layers(self) -> bool: ...
    @property
    def looks(self) -> Looks | None: ...

    def judge(self, sight: Sight) -> Judge[S]:
        """Pictures of the source to judge results by, drawn now."""
        ...

    def problem(self, quality: float) -> Problem:
        """The problem of encoding at the lambda predicted to give `quality` dB."""
        ...

    def finish(self, problem: Problem, decision: Decision) -> Quantised:
        """All integers of the file that `decision` says."""
        ...

    def finished(self, scene: QuantisedScene) -> S:
        """The scene that a decoder makes of the last layer of a file, for drawing."""
        ...
