"""The interface between the encoder and a profile."""

from __future__ import annotations

from typing import Protocol, TypeVar

from reference_encoder.importance.view_sampling import ViewSet
from reference_encoder.judge.quality import Judge
from reference_encoder.options import EncodeOptions
from reference_encoder.rdo.allocation import Allocation
from reference_encoder.rdo.rdo_input import RdoInput
from scarfmt.coding.writer import QuantisedScene, Report

S = TypeVar("S")


class Profile(Protocol[S]):
    """A scene that was measured: what errors in it show is known, and nothing is decided.

    Attributes:
        options: of the encoder.
        report: receives (stage, fraction done).
        previews: whether pictures of coarse layers can be drawn.
    """

    @property
    def options(self) -> EncodeOptions: ...
    @property
    def report(self) -> Report: ...
    @property
    def previews(self) -> bool: ...

    def judge(self, view_set: ViewSet) -> Judge[S]:
        """Pictures of the source to judge results by, drawn now."""
        ...

    def prepare(self, quality: float) -> RdoInput:
        """What is to be decided at the lambda predicted to give `quality` dB."""
        ...

    def quantise(self, problem: RdoInput, allocation: Allocation) -> QuantisedScene:
        """All integers of the file of an allocation."""
        ...

    def reconstruct(self, scene: QuantisedScene) -> S:
        """The scene that a decoder makes of the last layer of a file, for drawing."""
        ...
