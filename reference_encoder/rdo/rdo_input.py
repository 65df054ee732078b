"""What rate-distortion optimisation starts from, the same for both profiles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from reference_encoder.rdo.classes import Classes
from reference_encoder.rdo.latent import Latent
from reference_encoder.rdo.lattice import Placement
from scarfmt.arrays import F64, Floats
from scarfmt.container.schema import Profile, Stream
from scarfmt.scene.description import NOTHING_SAID, Description


@dataclass(frozen=True, kw_only=True)
class RdoInput:
    """N anchors without what is not worth sending, nothing else decided.

    What presence costs and what is lost is of all anchors that these stand for.

    Attributes:
        profile, slots, sh_degree: of the file.
        source_count: Gaussians or anchors of the source, those that were dropped included.
        description: of the source.
        positions: (N, 3) float64 true positions.
        placement: their cells and tiles.
        values: (N, components) float64 per channel, float32 of LATENT, in coding order, units of SPEC §9.
        weights: (N, components) or (N, 1) float64 squared picture error per squared unit.
        coarsest: coarsest useful first step per channel and component.
        latent: of view-dependent colours or features; None where nothing in them is worth sending.
        classes: anchors of like importance.
        lambda_: of the last layer, squared picture error per bit.
        base_share: share of the bits that the first layer takes.
        repeat: how many anchors each stands for.
    """

    profile: Profile
    slots: int
    sh_degree: int
    source_count: int
    positions: F64
    placement: Placement
    values: Mapping[Stream, Floats]
    weights: Mapping[Stream, F64]
    coarsest: Mapping[Stream, tuple[float, ...]]
    latent: Latent | None
    classes: Classes
    lambda_: float
    base_share: float
    repeat: float = 1.0
    description: Description = NOTHING_SAID
