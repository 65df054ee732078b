"""Shared parts of the writers of other formats: the description of a scene, the report, and the refusals."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import Bools
from scarfmt.container.registries import ColourSpace, CoordinateFrame
from scarfmt.errors import InvalidInput
from scarfmt.scene.gaussians import GaussianScene

Parts = Iterable[GaussianScene]
"""A scene in parts of any size, all of one SH degree: so it never has to be in memory whole."""


@dataclass(frozen=True)
class Described:
    """The properties of a whole scene.

    Attributes:
        sh_degree: of all its parts, 0..3.
        frame: which way its axes point; unspecified is taken for RDF.
        colour_space: what its colours measure; unspecified is taken for sRGB.
    """

    sh_degree: int
    frame: CoordinateFrame = CoordinateFrame.RDF
    colour_space: ColourSpace = ColourSpace.SRGB


@dataclass(frozen=True)
class Written:
    """The report of a writer.

    Attributes:
        count: Gaussians written.
        notes: what the format could not hold as it was, for people, a line each.
    """

    count: int
    notes: tuple[str, ...]


class Losses:
    """Counts Gaussians of which a format could not hold a value but changed it beyond its rounding."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def count(self, what: str, changed: Bools) -> None:
        """Add the rows of `changed`, (N, ...) bool, with any True; `what` says which values, and what came of them."""
        rows = int(np.count_nonzero(changed.reshape(len(changed), -1).any(axis=1)))
        self._counts[what] = self._counts.get(what, 0) + rows

    def notes(
        self, described: Described, total: int, *, axes_of: str | None = None, colours_of: str | None = None
    ) -> tuple[str, ...]:
        """A line for each kind of change there was.

        Args:
            described: the scene.
            total: Gaussians written.
            axes_of: the format, where it fixes axes and the scene may not say which it has.
            colours_of: the format, where it cannot say that colours are linear.
        """
        found = [f"{what}: {count:,} of {total:,} Gaussians" for what, count in self._counts.items() if count]
        if axes_of is not None and described.frame == CoordinateFrame.UNSPECIFIED:
            found.append(f"the scene does not say where its axes point: taken for RDF, and turned for {axes_of}")
        if colours_of is not None and described.colour_space == ColourSpace.LINEAR:
            found.append(f"its colours are linear, which {colours_of} cannot say: readers will take them for sRGB")
        return tuple(found)


def finite(parts: Parts, title: str) -> Iterator[GaussianScene]:
    """The parts that hold any Gaussian.

    Raises:
        InvalidInput: ``output-range``: a value is NaN or infinite; ``output-empty``, at the end: there was none.
    """
    count = 0
    for part in parts:
        bad = part.invalid_rows()
        if bad.any():
            row = count + int(np.argmax(bad))
            message = f"Gaussian {row} holds NaN or infinite values, which {title} cannot; leave such Gaussians out"
            raise InvalidInput("output-range", message)
        count += len(part)
        if len(part):
            yield part
    if not count:
        raise InvalidInput("output-empty", f"there are no Gaussians to write: an empty {title} is not valid")
