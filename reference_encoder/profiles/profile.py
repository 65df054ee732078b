"""What the pipeline asks of a profile (encoder side)."""

from __future__ import annotations

from typing import Protocol

from reference_encoder.decide.assemble import Quantised
from reference_encoder.decide.decision import Decision
from reference_encoder.decide.problem import Problem
from reference_encoder.judge.calibrate import Judge
from reference_encoder.judge.looks import Looks
from reference_encoder.options import EncodeOptions
from scarfmt.coding.writer import Report


class Profile(Protocol):
    """A scene that was measured: what errors in it show is known, and nothing is decided.

    Attributes:
        options: of the encoder.
        report: told (stage, fraction done).
        source_count: Gaussians or anchors of the source.
        judge: pictures of the source to judge results by; None where results cannot be drawn.
        looks: pictures of the source to judge layers by; None likewise.
    """

    @property
    def options(self) -> EncodeOptions: ...
    @property
    def report(self) -> Report: ...
    @property
    def source_count(self) -> int: ...
    @property
    def judge(self) -> Judge | None: ...
    @property
    def looks(self) -> Looks | None: ...

    def problem(self, quality: float) -> Problem:
        """What there is to decide at the lambda that is predicted to give `quality` dB."""
        ...

    def finish(self, problem: Problem, decision: Decision) -> Quantised:
        """All integers of the file that `decision` says."""
        ...
