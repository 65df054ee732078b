"""The request of a decode, which decoding, exporting, the API and the command line share."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from scarfmt.arrays import F64
from scarfmt.errors import InvalidInput
from scarfmt.limits import DEFAULT_LIMITS, Limits
from scarfmt.scene.streams import ATTRIBUTES

Box = tuple[Sequence[float], Sequence[float]]


@dataclass(frozen=True, kw_only=True)
class DecodeRequest:
    """The part of a file to decode, and how. The values are those of decoding the whole file.

    Attributes:
        layers: layers to decode, from the first; None for all that are there.
        tiles: tile indices, in the order wanted; None for all.
        box: lowest and highest world coordinates; anchors (not Gaussians) outside are left out, and tiles that
            cannot hold any inside are not read.
        attributes: names of `scarfmt.scene.streams.ATTRIBUTES`; None for all. Classes and lattice positions are
            always read.
        limits: what to accept of the file (SPEC §13).
        threads: tiles decoded side by side, 1 or more; the result does not depend on it. None for as many as the
            process may use processors.
        allow_truncated: use the whole layers of a file cut short instead of refusing it.
        backend: the engine, one of `reference_decoder.backends.BACKENDS`; the result does not
            depend on it.
    """

    layers: int | None = None
    tiles: Sequence[int] | None = None
    box: Box | None = None
    attributes: Collection[str] | None = None
    limits: Limits = DEFAULT_LIMITS
    threads: int | None = None
    allow_truncated: bool = False
    backend: str = "auto"

    @property
    def workers(self) -> int:
        """How many tiles are decoded side by side."""
        return processors() if self.threads is None else self.threads

    def names(self) -> frozenset[str]:
        """The attributes to decode: a box needs positions, whatever else is asked for.

        Raises:
            InvalidInput: ``input-attributes`` for a name that no attribute has.
        """
        names = frozenset(ATTRIBUTES if self.attributes is None else self.attributes)
        if not names <= set(ATTRIBUTES):
            unknown = ", ".join(sorted(names - set(ATTRIBUTES)))
            raise InvalidInput("input-attributes", f"no attribute {unknown}; choose from {', '.join(ATTRIBUTES)}")
        return names if self.box is None else names | {"positions"}

    def corners(self) -> tuple[F64, F64] | None:
        """The (3,) float64 lowest and highest corner of the box, None without one.

        Raises:
            InvalidInput: ``input-box`` when these are not three coordinates each, the lowest first.
        """
        if self.box is None:
            return None
        low, high = (np.asarray(corner, np.float64) for corner in self.box)
        if low.shape != (3,) or high.shape != (3,) or not bool((low <= high).all()):
            raise InvalidInput("input-box", "a box needs its 3 lowest and its 3 highest coordinates", field="box")
        return low, high


class RequestFields(TypedDict, total=False):
    """The fields of a :class:`DecodeRequest` as keywords, for functions that build one."""

    layers: int | None
    tiles: Sequence[int] | None
    box: Box | None
    attributes: Collection[str] | None
    limits: Limits
    threads: int | None
    allow_truncated: bool
    backend: str


def processors() -> int:
    """How many processors this process may use, where the system says so."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


def requested(request: DecodeRequest | None, fields: RequestFields) -> DecodeRequest:
    """The request of a call: one given whole, or the one its keywords describe.

    Raises:
        TypeError: both were given, or a keyword that is no field.
    """
    if request is None:
        return DecodeRequest(**fields)
    if fields:
        raise TypeError(f"give a DecodeRequest or its fields, not both: {', '.join(fields)}")
    return request
