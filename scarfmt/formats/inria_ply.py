"""INRIA's 3D Gaussian splatting PLY, as every trainer writes it: one `vertex` row for each Gaussian.

Properties, of any numeric type, in any order, text or binary; others (normals, say) are ignored:

- ``x y z``: position in world units.
- ``f_dc_0..2``, ``f_rest_0..``: spherical harmonics, `f_rest` channel-major, 0, 9, 24, 45 or 72 of them; what is above
  degree 3 is left out. Scenes without view-dependent colour may have ``red green blue`` instead, uchar or ushort.
- ``opacity``: logit.
- ``filter_3D``: Mip-Splatting's smoothing filter, a standard deviation that its trainer adds to every size.
- ``scale_0..2``: natural log. 2D Gaussian scenes have two; the third is then set to log(1e-9), a flat disk. Balls, such
  as those of MonoGS, have one, which holds for all axes.
- ``rot_0..3``: quaternion w, x, y, z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F64
from scarfmt.errors import InvalidInput
from scarfmt.formats import ply
from scarfmt.formats.quantise import FLAT_LOG_SCALE, dc_of_colour, opacities, sh_from_channel_major
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene

_COEFFICIENTS = {0: 0, 9: 3, 24: 8, 45: 15, 72: 24}
"""Numbers of f_rest columns, and how many of them each colour has."""
_MOST = 15
DC = ("f_dc_0", "f_dc_1", "f_dc_2")
SCALES, ROTATION = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
"""Columns of a Gaussian, which :mod:`.export_ply` writes too."""
_RGB = ("red", "green", "blue")
_LARGEST = {"u1": 255.0, "u2": 65535.0}
_FILTER = "filter_3D"
_HARMLESS = ("nx", "ny", "nz", *_RGB, "alpha", "state", "transform")
"""Columns beside those of Gaussians that do not change the picture; the last two are left by SuperSplat."""
_KNOWN = frozenset(("x", "y", "z", "opacity", *DC, *SCALES, *ROTATION, _FILTER, *_HARMLESS))


sniff, describe = ply.is_ply, ply.describe


def load(source: Source) -> GaussianScene:
    """Read an INRIA-layout PLY.

    Raises:
        InvalidInput: damaged, or not a Gaussian scene.
        LimitExceeded: more rows than any scene has.
    """
    header = ply.read_header(source)
    columns = Columns.of(source, header)
    for note in columns.notes:
        source.warn(note)
    scene = columns.scene(ply.read_elements(source, header, ["vertex"])["vertex"])
    _warn_of_plain_numbers(source, scene)
    return scene


@dataclass(frozen=True)
class Columns:
    """The columns of the attributes of Gaussians in the rows of a file.

    Attributes:
        scales: names of the one to three scales.
        colours: names of the colours of degree 0.
        rest: names of the coefficients above degree 0.
        smoothed: whether there is a filter to apply.
        notes: what is not read as it is, for people.
    """

    scales: tuple[str, ...]
    colours: tuple[str, ...]
    rest: tuple[str, ...]
    smoothed: bool
    notes: tuple[str, ...]

    @classmethod
    def of(cls, source: Source, header: ply.Header) -> Columns:
        """The columns of a file, after a check that none is missing.

        Raises:
            InvalidInput: ``input-not-gaussians``, ``input-sh-degree``.
        """
        vertex = header.elements.get("vertex")
        if vertex is None:
            there = ", ".join(header.elements)[:80] or "nothing"
            message = f"{source.name}: a PLY of {there}, without vertices; give a trained 3D Gaussian scene"
            raise InvalidInput("input-not-gaussians", message, field="vertex")
        kinds = vertex.properties
        names = [name for name, kind in kinds.items() if kind != ply.LIST]
        colours = DC if set(DC) & set(names) or not set(_RGB) <= set(names) else _RGB
        _check_columns(source, names, colours)
        if colours == _RGB and any(ply.TYPES[kinds[name]] not in _LARGEST for name in _RGB):
            message = f"{source.name}: red, green and blue of type {kinds['red']}, whose range nothing says"
            raise InvalidInput("input-not-gaussians", f"{message}; export them as f_dc or uchar", field="vertex.red")
        rest, notes = _rest_columns(source, names)
        if colours == _RGB:
            notes += ("colours are read from red, green and blue: they have no f_dc",)
        scales = tuple(name for name in SCALES if name in names)
        return cls(scales, colours, rest, _FILTER in names, notes + _unread_columns(names))

    def positions(self, rows: ply.Rows) -> F64:
        """(N, 3) float64."""
        return ply.columns(rows, ["x", "y", "z"]).astype(np.float64)

    def scene(self, rows: ply.Rows) -> GaussianScene:
        """The Gaussians of some rows."""
        scales = ply.columns(rows, list(self.scales))
        if len(self.scales) == 1:
            scales = np.repeat(scales, 3, axis=1)
        logits = ply.columns(rows, ["opacity"])[:, 0]
        if self.smoothed:
            scales, logits = _smooth(scales, logits, rows[_FILTER])
        if len(self.scales) == 2:
            scales = np.pad(scales, ((0, 0), (0, 1)), constant_values=FLAT_LOG_SCALE)
        with np.errstate(over="ignore"):  # doubles beyond float32 become infinities, which a later check reports
            return GaussianScene(
                self.positions(rows),
                scales.astype(np.float32),
                ply.columns(rows, list(ROTATION)).astype(np.float32),
                logits.astype(np.float32),
                sh_from_channel_major(self._dc(rows), ply.columns(rows, list(self.rest))),
            )

    def _dc(self, rows: ply.Rows) -> NDArray[np.generic]:
        """(N, 3) coefficients of degree 0."""
        stored = ply.columns(rows, list(self.colours))
        if self.colours == DC:
            return stored
        largest = [_LARGEST[rows.dtype[name].str[1:]] for name in self.colours]
        return dc_of_colour(stored.astype(np.float64) / largest)[:, 0]


_FEW = 16
"""Gaussians of which nothing can be said together."""


def _warn_of_plain_numbers(source: Source, scene: GaussianScene) -> None:
    """Tell where numbers look as renderers use them: opacities all from 0 to 1, or sizes all wider than the scene.

    Logits of trained scenes reach from below -2 to above 2.
    """
    if len(scene) < _FEW:
        return
    logits = scene.opacity_logits
    is_plain = bool(((logits >= 0) & (logits <= 1)).all() and np.ptp(logits) > 0)
    is_wider = False
    if (scene.log_scales >= 0).all():
        with np.errstate(all="ignore"):  # what is not finite is reported by a later check
            away = np.abs(scene.positions - np.median(scene.positions, axis=0)).max(axis=1)
            is_wider = bool(np.median(scene.log_scales) > np.log(np.quantile(away, 0.9)))
    if is_plain or is_wider:
        what = "all opacities lie from 0 to 1" if is_plain else "most Gaussians are wider than the scene"
        message = f"{what}; if opacities are no logits, or sizes no logarithms"
        source.warn(f"{message}, export it again: some tools write what renderers use, PLY has what trainers keep")


def _smooth(scales: NDArray[np.generic], logits: NDArray[np.generic], width: NDArray[np.generic]) -> tuple[F64, F64]:
    """Log scales and logits under a filter: Gaussians wider by it, and fainter so that each shows as much."""
    log_scales, opacity = scales.astype(np.float64), opacities(logits.astype(np.float32))
    with np.errstate(divide="ignore", invalid="ignore"):
        wider = 0.5 * np.logaddexp(2 * log_scales, 2 * np.log(width.astype(np.float64))[:, None])
        fainter = opacity * np.exp((log_scales - wider).sum(axis=1))
        return wider, np.log(fainter) - np.log1p(-fainter)


def _check_columns(source: Source, names: list[str], colours: tuple[str, ...]) -> None:
    required = ["x", "y", "z", SCALES[0], *ROTATION, "opacity", *colours]
    # The third scale may be missing, or both the second and the third.
    required += SCALES[1:2] if SCALES[2] in names else ()
    missing = [name for name in required if name not in names]
    if missing:
        kind = "a point cloud or mesh, not a Gaussian scene" if "scale_0" in missing else "not a complete scene"
        raise InvalidInput(
            "input-not-gaussians",
            f"{source.name}: {kind}: the PLY vertices lack {', '.join(missing)}; give a trained 3D Gaussian scene",
            field="vertex",
        )


def _rest_columns(source: Source, names: list[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The f_rest columns up to degree 3, in order, and a note on what is left out."""
    found = {name for name in names if name.startswith("f_rest_")}
    each = _COEFFICIENTS.get(len(found))
    if each is None or found != {f"f_rest_{i}" for i in range(len(found))}:
        raise InvalidInput(
            "input-sh-degree",
            f"{source.name}: {len(found)} f_rest properties; expected f_rest_0 on, 0, 9, 24, 45 or 72 of them"
            " (degree 0..4)",
            field="vertex.f_rest",
        )
    kept = tuple(f"f_rest_{colour * each + i}" for colour in range(3) for i in range(min(each, _MOST)))
    return kept, ("spherical harmonics of degree 4 are left out: scenes here have degree 3",) if each > _MOST else ()


def _unread_columns(names: list[str]) -> tuple[str, ...]:
    """A note on columns that may change the picture, such as those of motion."""
    unread = [name for name in names if name not in _KNOWN and not name.startswith("f_rest_")]
    if not unread:
        return ()
    more = f" and {len(unread) - 4} more" if len(unread) > 4 else ""
    return (f"not read, though they may change the picture, such as by motion: columns {', '.join(unread[:4])}{more}",)
