"""Deciding what to do with an imported scene that is empty or holds values that are not finite, or absurd.

Infinities that mean something are values: an opacity logit of +-inf is opaque or transparent, a log scale of -inf flat.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import I64
from scarfmt.errors import InputWarning, InvalidInput
from scarfmt.formats.quantise import FLAT_LOG_SCALE
from scarfmt.scene.gaussians import AnchorModel, GaussianScene

MAX_COEFFICIENT = 1 << 20
"""Largest magnitude of a coefficient of spherical harmonics that is encoded. Trained scenes stay below 100. Far beyond,
the integers of a file could not hold it in steps that show in the other Gaussians."""

MAX_LOGIT = 20.0
"""Magnitude of the opacity logits that stand for infinite ones: 2e-9 from 0 and from 1."""
_VISIBLE_LOGIT = -math.log(254)
"""Of an opacity of 1/255, below which renderers draw nothing."""

Counts = dict[str, int]
"""Gaussians by what there is to tell of them."""


def keep_edges(scene: GaussianScene) -> tuple[GaussianScene, Counts]:
    """A scene whose meaningful infinities are finite, and what there is to tell of its Gaussians.

    Returns:
        The scene (the same object where nothing changed), and numbers of Gaussians: of infinite logits and flat axes,
        which are kept, and of rows that look empty, which are kept as they are.
    """
    endless = np.isinf(scene.opacity_logits)
    flat = np.isneginf(scene.log_scales)
    still = ~scene.rotations.any(axis=1)
    empty = still & ~scene.positions.any(axis=1) & ~scene.sh.any(axis=(1, 2)) & ~scene.log_scales.any(axis=1)
    counts = {
        "have an infinite opacity logit: kept as opaque or transparent": endless,
        "have a size of 0 along an axis: kept as flat": flat.any(axis=1),
        "are rows of zeros, as some exporters leave them: kept; remove them with the tool that wrote the file": empty,
        "have a rotation of length 0, which is taken for none": still & ~empty,
    }
    if endless.any() or flat.any():
        finite = scene.log_scales[np.isfinite(scene.log_scales)]
        least = min(FLAT_LOG_SCALE, float(finite.min(initial=0.0)))
        scene = replace(
            scene,
            log_scales=np.where(flat, np.float32(least), scene.log_scales),
            opacity_logits=np.where(endless, np.sign(scene.opacity_logits) * MAX_LOGIT, scene.opacity_logits).astype(
                np.float32
            ),
        )
    return scene, {what: int(np.count_nonzero(rows)) for what, rows in counts.items()}


def warn_of(counts: Counts, total: int) -> None:
    """Tell what :func:`keep_edges` counted among `total` Gaussians."""
    for what, count in counts.items():
        if count:
            warnings.warn(f"{count:,} of {total:,} Gaussians {what}", InputWarning, stacklevel=3)


@overload
def clean(scene: GaussianScene, drop_invalid: bool = ...) -> tuple[GaussianScene, int]: ...
@overload
def clean(scene: AnchorModel, drop_invalid: bool = ...) -> tuple[AnchorModel, int]: ...
def clean(scene: GaussianScene | AnchorModel, drop_invalid: bool = False) -> tuple[GaussianScene | AnchorModel, int]:
    """A scene that can be encoded: not empty, every value finite, no coefficient beyond `MAX_COEFFICIENT`.

    Args:
        scene: Gaussians or anchors.
        drop_invalid: leave out rows with such values instead of refusing the scene.

    Returns:
        The scene (the same object where nothing was dropped) and the number of rows dropped.

    Raises:
        InvalidInput: no rows, or none left (refusal `input-empty`); values that are not finite, without
            `drop_invalid` or in a network's weights (refusal `input-not-finite`); coefficients of spherical
            harmonics beyond `MAX_COEFFICIENT`, without `drop_invalid` (refusal `input-range`).

    Warns:
        InputWarning: what :func:`keep_edges` tells, and what is dropped.
    """
    if len(scene) == 0:
        raise InvalidInput("input-empty", "the scene holds no Gaussians; there is nothing to encode")
    if isinstance(scene, AnchorModel):
        _check_networks(scene)
        bad = _invalid_anchors(scene)
    else:
        scene, counts = keep_edges(scene)
        faults = Faults.of(scene)
        if not drop_invalid:
            faults.refuse()
        bad = faults.rows
        warn_of(counts, len(scene))
    dropped = int(np.count_nonzero(bad))
    if dropped == 0:
        return scene, 0
    if not drop_invalid:
        raise _not_finite(dropped, len(scene), f"row {int(np.argmax(bad))}", None)
    if dropped == len(scene):
        raise nothing_left(dropped)
    if isinstance(scene, GaussianScene):
        warn_dropped(dropped, len(scene), faults.visible)
        return scene.take(~bad), dropped
    return _take_anchors(scene, ~bad), dropped


@dataclass(frozen=True)
class Faults:
    """The Gaussians of a scene that cannot be encoded, by kind of fault.

    Attributes:
        count: Gaussians looked at.
        rows: (count,) bool: those with such values.
        first: which row of which file is the first with a NaN or an infinity, for people; None without one.
        absurd: name, place and value of the first coefficient beyond `MAX_COEFFICIENT`; None without one.
        visible: how many of the rows have an opacity that shows.
    """

    count: int
    rows: NDArray[np.bool_]
    first: str | None
    absurd: tuple[str, str, float] | None
    visible: int

    @classmethod
    def of(cls, scene: GaussianScene, numbers: I64 | None = None, file: str = "") -> Faults:
        """Find the faults of a scene.

        Args:
            scene: some Gaussians.
            numbers: (N,) which rows of a file they are; None where they are the first N.
            file: what to call the file, where there are several.
        """
        bad = scene.invalid_rows()
        absurd = (np.abs(scene.sh.reshape(len(scene), -1)) > MAX_COEFFICIENT).any(axis=1)

        def place(row: int) -> str:
            number = row if numbers is None else int(numbers[row])
            return f"row {number} of {file}" if file else f"row {number}"

        first = place(int(np.argmax(bad))) if bad.any() else None
        found = None
        if absurd.any():
            row = int(np.argmax(absurd))
            name, value = _largest_coefficient(scene, row)
            found = name, place(row), value
        rows = bad | absurd
        visible = int(np.count_nonzero(scene.opacity_logits[rows] > _VISIBLE_LOGIT))
        return cls(len(scene), rows, first, found, visible)

    def refuse(self) -> None:
        """Refuse the scene if there are any.

        Raises:
            InvalidInput: ``input-not-finite``, ``input-range``.
        """
        Faults.refusal(int(np.count_nonzero(self.rows)), self.count, self.first, self.absurd, self.visible)

    @staticmethod
    def refusal(
        dropped: int, count: int, first: str | None, absurd: tuple[str, str, float] | None, visible: int
    ) -> None:
        """Refuse `count` Gaussians, `dropped` of which cannot be encoded, if there is a first of them.

        Raises:
            InvalidInput: ``input-not-finite``, ``input-range``.
        """
        if first is not None:
            raise _not_finite(dropped, count, first, visible)
        if absurd is not None:
            raise _absurd(*absurd, dropped, visible)


def _largest_coefficient(scene: GaussianScene, row: int) -> tuple[str, float]:
    """The coefficient of a row with the largest magnitude, named as .ply files do."""
    values = np.abs(scene.sh[row])
    coefficient, colour = (int(place) for place in np.unravel_index(values.argmax(), values.shape))
    name = f"f_dc_{colour}" if coefficient == 0 else f"f_rest_{colour * (len(values) - 1) + coefficient - 1}"
    return name, float(scene.sh[row, coefficient, colour])


def warn_dropped(dropped: int, count: int, visible: int) -> None:
    """Tell what leaving out unusable Gaussians cost."""
    message = f"left out {dropped:,} of {count:,} Gaussians with unusable values, {_how_visible(dropped, visible)}"
    warnings.warn(message, InputWarning, stacklevel=3)


def _how_visible(dropped: int, visible: int) -> str:
    return "none of them visible" if not visible else f"{visible:,} of these {dropped:,} visible"


def _not_finite(dropped: int, count: int, first: str, visible: int | None) -> InvalidInput:
    cost = "" if visible is None else f", {_how_visible(dropped, visible)}"
    return InvalidInput(
        "input-not-finite",
        f"{dropped} of {count} rows hold NaN or infinite values, the first is {first}; "
        f"use --drop-invalid to leave them out{cost}",
    )


def nothing_left(dropped: int) -> InvalidInput:
    """The refusal of a scene none of whose Gaussians can be encoded."""
    return InvalidInput("input-empty", f"all {dropped} rows hold unusable values; nothing is left to encode")


def _absurd(name: str, place: str, value: float, dropped: int, visible: int) -> InvalidInput:
    return InvalidInput(
        "input-range",
        f"{name} of {place} is {value:g}; at most +-{MAX_COEFFICIENT:,} is encoded; "
        f"use --drop-invalid to leave {dropped} such rows out, {_how_visible(dropped, visible)}",
        field=name,
    )


def _invalid_anchors(model: AnchorModel) -> NDArray[np.bool_]:
    """(N,) bool: anchors holding a NaN or an infinity."""
    bad = np.zeros(len(model), np.bool_)
    for values in (model.anchors, model.features, model.offsets.reshape(len(model), -1), model.log_scaling):
        bad |= ~np.isfinite(values).all(1)
    return bad


def _take_anchors(model: AnchorModel, keep: NDArray[np.bool_]) -> AnchorModel:
    return replace(
        model,
        anchors=model.anchors[keep],
        features=model.features[keep],
        offsets=model.offsets[keep],
        log_scaling=model.log_scaling[keep],
        slot_mask=None if model.slot_mask is None else model.slot_mask[keep],
    )


def _check_networks(model: AnchorModel) -> None:
    """A network's weights belong to every anchor, so they cannot be dropped."""
    for name, mlp in model.mlps.items():
        if not all(np.isfinite(values).all() for values in (*mlp.weights, *mlp.biases)):
            message = "a network holds NaN or infinite weights; train or export the model again"
            raise InvalidInput("input-not-finite", message, field=f"mlps.{name}")
