"""The anchor profile: a Scaffold-GS style model to a :class:`QuantisedScene` (encoder side)."""

from __future__ import annotations

from reference_encoder.options import EncodeOptions
from scarfmt.scene import AnchorModel
from scarfmt.writer import QuantisedScene, Report


def encode_anchors(model: AnchorModel, options: EncodeOptions, report: Report) -> QuantisedScene:
    raise NotImplementedError
