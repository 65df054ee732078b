"""INRIA's 3D Gaussian splatting PLY, as every trainer writes it: one `vertex` row for each Gaussian.

Properties, of any numeric type, in any order, text or binary; others (normals, say) are ignored:

- ``x y z``: position in world units.
- ``f_dc_0..2``, ``f_rest_0..``: spherical harmonics, `f_rest` channel-major, 0, 9, 24 or 45 of them.
- ``opacity``: logit.
- ``scale_0..2``: natural log. 2D Gaussian scenes have two; the third is then set to log(1e-9), a flat disk.
- ``rot_0..3``: quaternion w, x, y, z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from scarfmt.arrays import F32, F64
from scarfmt.errors import InvalidInput
from scarfmt.formats import ply, ply_body
from scarfmt.formats.dequantise import sh_from_channel_major
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene

FLAT_LOG_SCALE = math.log(1e-9)
"""Log scale given to the missing third axis of a 2D Gaussian."""

_REST_COUNTS = (0, 9, 24, 45)


def sniff(source: Source) -> bool:
    """Whether the content is a PLY file."""
    return ply.is_ply(source)


def load(source: Source) -> GaussianScene:
    """Read an INRIA-layout PLY.

    Raises:
        InvalidInput: damaged, or not a Gaussian scene.
        LimitExceeded: more rows than any scene has.
    """
    header = ply.read_header(source)
    columns = Columns.of(source, header)
    return columns.scene(ply_body.read_elements(source, header, ["vertex"])["vertex"])


@dataclass(frozen=True)
class Columns:
    """The columns of the attributes of Gaussians in the rows of a file.

    Attributes:
        scales: names of the two or three scales.
        rest: names of the coefficients above degree 0.
    """

    scales: tuple[str, ...]
    rest: tuple[str, ...]

    @classmethod
    def of(cls, source: Source, header: ply.Header) -> Columns:
        """The columns of a file, after a check that none is missing.

        Raises:
            InvalidInput: ``input-not-gaussians``, ``input-sh-degree``.
        """
        vertex = header.elements.get("vertex")
        names = [] if vertex is None else [name for name, kind in vertex.properties.items() if kind != ply.LIST]
        rest = _required_columns(source, names)
        return cls(tuple(name for name in ("scale_0", "scale_1", "scale_2") if name in names), tuple(rest))

    def positions(self, rows: ply_body.Rows) -> F64:
        """(N, 3) float64."""
        return ply_body.columns(rows, ["x", "y", "z"]).astype(np.float64)

    def scene(self, rows: ply_body.Rows) -> GaussianScene:
        """The Gaussians of some rows."""
        scales = ply_body.columns(rows, list(self.scales))
        dc = ply_body.columns(rows, ["f_dc_0", "f_dc_1", "f_dc_2"])[:, None, :]
        harmonics = sh_from_channel_major(ply_body.columns(rows, list(self.rest)))
        with np.errstate(over="ignore"):  # doubles beyond float32 become infinities, which a later check reports
            return GaussianScene(
                self.positions(rows),
                _with_third_axis(scales.astype(np.float32)),
                ply_body.columns(rows, [f"rot_{i}" for i in range(4)]).astype(np.float32),
                ply_body.columns(rows, ["opacity"])[:, 0].astype(np.float32),
                np.concatenate([dc.astype(np.float32), harmonics], axis=1),
            )


def _required_columns(source: Source, names: list[str]) -> list[str]:
    """Check that all attributes are there; the f_rest columns in order."""
    required = ["x", "y", "z", "scale_0", "scale_1", *(f"rot_{i}" for i in range(4)), "opacity"]
    required += [f"f_dc_{i}" for i in range(3)]
    missing = [name for name in required if name not in names]
    if missing:
        kind = "a point cloud or mesh, not a Gaussian scene" if "scale_0" in missing else "not a complete scene"
        raise InvalidInput(
            "input-not-gaussians",
            f"{source.name}: {kind}: the PLY vertices lack {', '.join(missing)}; give a trained 3D Gaussian scene",
            field="vertex",
        )
    rest = sorted((name for name in names if name.startswith("f_rest_")), key=lambda name: (len(name), name))
    if len(rest) not in _REST_COUNTS or rest != [f"f_rest_{i}" for i in range(len(rest))]:
        raise InvalidInput(
            "input-sh-degree",
            f"{source.name}: {len(rest)} f_rest properties; expected f_rest_0 on, 0, 9, 24 or 45 of them (degree 0..3)",
            field="vertex.f_rest",
        )
    return rest


def _with_third_axis(log_scales: F32) -> F32:
    if log_scales.shape[1] == 3:
        return log_scales
    return np.pad(log_scales, ((0, 0), (0, 1)), constant_values=np.float32(FLAT_LOG_SCALE))
