"""Encoding: from a scene to the bytes of a `.scar` file (encoder side; nothing here is normative).

:mod:`reference_encoder.pipeline` has the stages, one after another.
"""

from __future__ import annotations

from reference_encoder.options import EncodeOptions
from reference_encoder.pipeline import Encoded, encoded
from scarfmt.coding.writer import Report, silent
from scarfmt.errors import InvalidInput
from scarfmt.render.capture.seen import warn_of_strangers
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

__all__ = ["EncodeOptions", "encode"]


def encode(
    scene: GaussianScene | AnchorModel, options: EncodeOptions | None = None, report: Report = silent
) -> Encoded:
    """The bytes of a file for `scene`: the same for the same scene, options, packages and BLAS kernel.

    What another BLAS kernel changes, and what nothing changes: `EncodeOptions.seed`.

    Args:
        scene: without NaN or infinity (see `scarfmt.formats.clean`), at least one Gaussian or anchor.
        options: None for the defaults.
        report: told (stage, fraction done).

    Raises:
        InvalidInput: ``input-empty``, ``input-options``, ``input-anchors``, ``input-dependency``.

    Warns:
        InputWarning: the cameras given do not look at the scene.
    """
    options = options or EncodeOptions()
    options.check()
    if len(scene) == 0:
        raise InvalidInput("input-empty", "the scene holds no Gaussian: there is nothing to encode")
    if options.cameras:
        warn_of_strangers(scene.positions if isinstance(scene, GaussianScene) else scene.anchors, options.cameras)
    return encoded(scene, options, report)
