"""What the writers of formats share: the scene in parts, what a format loses of it, and streams that wait on disk."""

from __future__ import annotations

import itertools
import math
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from enum import Flag, auto
from typing import BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, Bools
from scarfmt.container.registries import ColourSpace, CoordinateFrame, RenderModel
from scarfmt.errors import InvalidInput
from scarfmt.formats.clean import keep_edges
from scarfmt.formats.quantise import FLAT_LOG_SCALE
from scarfmt.scene.description import NOTHING_SAID, USUAL_UP, Description
from scarfmt.scene.gaussians import GaussianScene

_MEMORY_BYTES = 1 << 22
"""Maximum bytes of each stream in memory; the rest is on disk."""
_COPY_BYTES = 1 << 20


class Spool(ExitStack):
    """Named streams in temporary files, to be used as a context manager: together as large as what is written."""

    def __init__(self, names: Iterable[str]):
        super().__init__()
        self._streams: dict[str, BinaryIO] = {}
        for name in names:
            stream = self.enter_context(tempfile.SpooledTemporaryFile(_MEMORY_BYTES))  # noqa: SIM115 - the stack closes it
            self._streams[name] = cast(BinaryIO, stream)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the streams, in the order given."""
        return tuple(self._streams)

    def add(self, name: str, values: NDArray[np.generic]) -> None:
        """Append the bytes of an array, in C order."""
        self._streams[name].write(np.ascontiguousarray(values).data)

    def size(self, name: str) -> int:
        """Bytes of a stream so far."""
        return self._streams[name].tell()

    def reopen(self, name: str) -> BinaryIO:
        """A stream from its beginning, to be read."""
        self._streams[name].seek(0)
        return self._streams[name]

    def copy(self, name: str, target: BinaryIO) -> None:
        """Write a stream to `target`."""
        shutil.copyfileobj(self.reopen(name), target, _COPY_BYTES)


Parts = Iterable[GaussianScene]
"""A scene in parts of any size, all of one SH degree: so it never has to be in memory whole."""


@dataclass(frozen=True)
class Described:
    """The properties of a whole scene.

    Attributes:
        sh_degree: of all its parts, 0..3.
        frame: which way its axes point; unspecified is taken for RDF.
        description: what its source says about it; an unspecified colour space is taken for sRGB.
        count: Gaussians of all parts, where that is known before.
        comments: what a reader should know about them, an ASCII line each.
        places: (n, 3) float64 positions that tell where it lies; None for those of its first part.
        moved: what was subtracted from all positions.
    """

    sh_degree: int
    frame: CoordinateFrame = CoordinateFrame.RDF
    description: Description = NOTHING_SAID
    count: int | None = None
    comments: tuple[str, ...] = ()
    places: F64 | None = None
    moved: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, scene: GaussianScene) -> Described:
        """The properties of a scene in memory, as importers give it."""
        return cls(scene.sh_degree, description=scene.description, count=len(scene), places=scene.positions)

    @property
    def origin(self) -> tuple[float, float, float]:
        """What has to be added to positions, as written, for those that the source names, world units."""
        x, y, z = (kept + moved for kept, moved in zip(self.description.origin, self.moved, strict=True))
        return x, y, z


_FINE = 32
"""Steps of float32 for each size of a Gaussian: with fewer, what lies far from zero is moved."""
_FAR = 4
"""A scene is moved if it lies so many times its own extent from zero."""


def move_near_zero(parts: Parts, described: Described) -> tuple[Parts, Described]:
    """A scene whose positions would lose what shows in float32, such as one in coordinates of a map, with an origin
    subtracted; any other as it is.

    The origin is in whole units, and the middle of the scene: a few Gaussians far from all others do not matter.
    """
    rest = iter(parts)
    first = next(rest, None)
    if first is None:
        return (), described
    parts = itertools.chain([first], rest)
    places = first.positions if described.places is None else described.places
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return parts, described
    origin = np.rint(_middle(places)) + 0.0  # no -0 in messages
    far = float(np.abs(origin).max())
    reach = float(np.sort(np.abs(places - origin).max(axis=1))[9 * (len(places) - 1) // 10])
    size = float(_middle(gaussian_sizes(first.log_scales)))
    if far < _FAR * reach or far > np.finfo(np.float32).max or np.spacing(np.float32(far)) * _FINE < size:
        return parts, described
    x, y, z = origin.tolist()
    moved = (replace(part, positions=part.positions - origin) for part in parts)
    return moved, replace(described, moved=(x, y, z))


def _middle(values: F64) -> F64:
    """The median along the first axis. NumPy's own loads another 20 ms of NumPy."""
    return np.asarray(np.sort(values, axis=0)[[(len(values) - 1) // 2, len(values) // 2]].mean(axis=0))


def gaussian_sizes(log_scales: F32) -> F64:
    """(N,) float64 standard deviation along the axis of middle length, world units."""
    return np.asarray(np.exp(np.sort(log_scales.astype(np.float64), axis=1)[:, 1]))


_FLAT = 1.01 * math.exp(FLAT_LOG_SCALE)
"""What stands for a size of 0, but for rounding."""


@dataclass(frozen=True)
class Written:
    """The report of a writer.

    Attributes:
        count: Gaussians written.
        notes: what the format could not hold as it was, for people, a line each.
        unit: of the count.
    """

    count: int
    notes: tuple[str, ...]
    unit: str = "Gaussian"


class Losses:
    """Counts Gaussians of which a format could not hold a value but changed it beyond its rounding."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._coarse = self._wide = 0
        self._largest_step = 0.0

    def count(self, what: str, changed: Bools) -> None:
        """Add the rows of `changed`, (N, ...) bool, with any True; `what` says which values, and what came of them."""
        rows = int(np.count_nonzero(changed.reshape(len(changed), -1).any(axis=1)))
        self._counts[what] = self._counts.get(what, 0) + rows

    def compare_steps(self, steps: F64 | float, sizes: F64) -> None:
        """Compare the steps of positions, (N,) or one, with (N,) :func:`gaussian_sizes` of the Gaussians they move.

        Those of size 0 have no width to be moved by.
        """
        is_wide = sizes > _FLAT
        self._coarse += int(np.count_nonzero((steps > sizes) & is_wide))
        self._wide += int(np.count_nonzero(is_wide))
        self._largest_step = max(self._largest_step, float(np.max(steps, initial=0.0)))

    def refuse_coarse(self, title: str, advice: str) -> None:
        """Refuse a scene of which most Gaussians would be moved by more than they are wide.

        Raises:
            InvalidInput: ``output-range``.
        """
        if 2 * self._coarse > self._wide:
            message = f"{title} would round positions to {self._largest_step:.3g}"
            raise InvalidInput("output-range", f"{message}, more than half of the Gaussians are wide; {advice}")

    def notes(self, described: Described, total: int, title: str, says: Says) -> tuple[str, ...]:
        """A line for each kind of change there was, and for all that the scene says and the format cannot.

        Args:
            says: what it has words for.
        """
        found = [f"{what}: {count:,} of {total:,} Gaussians" for what, count in self._counts.items() if count]
        if self._coarse:
            some = f"{self._coarse:,} of {self._wide:,} Gaussians"
            found.append(f"positions rounded to up to {self._largest_step:.3g}, more than they are wide: {some}")
        said, origin = described.description, described.origin
        if any(described.moved):
            found.append(f"positions are written less {_point(described.moved)}, so that float32 holds them")
        if Says.AXES in says and described.frame == CoordinateFrame.UNSPECIFIED:
            found.append(f"the scene does not say where its axes point: taken for RDF, and turned for {title}")
        if Says.LINEAR not in says and said.colour_space == ColourSpace.LINEAR:
            found.append(f"its colours are linear, which {title} cannot say: readers will take them for sRGB")
        if Says.RENDER_MODEL not in says and said.render_model != RenderModel.CLASSIC:
            name = said.render_model.name.lower().replace("_", "-")
            found.append(f"its Gaussians are {name}, which {title} cannot say: readers will draw them as classic ones")
        if Says.UP not in says and said.up_axis not in (None, USUAL_UP):
            found.append(f"its up axis is {said.up_axis}, which {title} cannot say: readers will show it on its side")
        if Says.ORIGIN not in says and any(origin):
            found.append(f"its origin is {_point(origin)}, which {title} cannot say: keep it with the file")
        if said.coordinate_reference and not says.can_name(said.coordinate_reference):
            found.append(f"its coordinate reference is {said.coordinate_reference[:60]}, which {title} cannot say")
        return tuple(found)


def _point(numbers: tuple[float, float, float]) -> str:
    return "({})".format(", ".join(f"{number:.12g}" for number in numbers))


class Says(Flag):
    """What a format has words for."""

    NOTHING = 0
    RENDER_MODEL = auto()
    UP = auto()
    ORIGIN = auto()
    EPSG = auto()
    """Coordinate references of a number, `EPSG:25832`."""
    ANY_REFERENCE = auto()
    LINEAR = auto()
    AXES = auto()
    """It fixes where axes point."""

    def can_name(self, coordinate_reference: str) -> bool:
        """Whether it has words for this coordinate reference."""
        return Says.ANY_REFERENCE in self or (Says.EPSG in self and coordinate_reference.startswith("EPSG:"))


def check_float32(positions: NDArray[np.floating], scales: NDArray[np.floating], title: str) -> None:
    """Refuse positions and sizes, (N, 3) each, that have become infinite as float32.

    Raises:
        InvalidInput: ``output-range``.
    """
    for what, values, more in (("position", positions, ""), ("size", scales, ", or write a PLY, which has logarithms")):
        beyond = int(np.count_nonzero(~np.isfinite(values).all(axis=1)))
        if beyond:
            message = f"the {what} of {beyond:,} of {len(values):,} Gaussians is too large for the float32 of {title}"
            raise InvalidInput("output-range", f"{message}; leave such Gaussians out{more}")


def finite(parts: Parts, title: str) -> Iterator[GaussianScene]:
    """The parts that hold any Gaussian, opaque and flat ones with finite numbers.

    Raises:
        InvalidInput: ``output-range``: a value is NaN or infinite; ``output-empty``, at the end: there was none.
    """
    count = 0
    for part in parts:
        bad = part.invalid_rows()
        if bad.any():
            part, _ = keep_edges(part)
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
