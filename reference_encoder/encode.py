"""Encoding: from a scene to the bytes of a `.scar` file (encoder side; nothing here is normative).

    sensitivity -> classes -> lattice -> RVQ -> layer table -> quantised integers -> networks -> writer

Every choice is made by one currency: lambda, squared picture error per bit. `quality` sets it.
"""

from __future__ import annotations

from reference_encoder.anchor_profile import encode_anchors
from reference_encoder.explicit_profile import encode_explicit
from reference_encoder.networks.smallest_file import smallest_file
from reference_encoder.options import EncodeOptions
from scarfmt.coding.writer import Report, silent
from scarfmt.errors import InvalidInput
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

__all__ = ["EncodeOptions", "encode"]


def encode(scene: GaussianScene | AnchorModel, options: EncodeOptions | None = None, report: Report = silent) -> bytes:
    """The bytes of a file for `scene`. The same scene and options give the same bytes.

    Args:
        scene: without NaN or infinity (see `scarfmt.formats.clean`), at least one Gaussian or anchor.
        options: None for the defaults.
        report: told (stage, fraction done).

    Raises:
        InvalidInput: ``input-empty``, ``input-options``.
    """
    options = options or EncodeOptions()
    options.check()
    if len(scene) == 0:
        raise InvalidInput("input-empty", "the scene holds no Gaussian: there is nothing to encode")
    if isinstance(scene, AnchorModel):
        quantised, targets = encode_anchors(scene, options, report)
    else:
        quantised, targets = encode_explicit(scene, options, report)
    return smallest_file(quantised, options, report, targets)
