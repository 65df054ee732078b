"""INRIA's PLY, written: all float, binary_little_endian, with normals; comments say what the scene says of itself."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import BinaryIO

import numpy as np

from scarfmt.arrays import F32
from scarfmt.container.registries import RenderModel
from scarfmt.errors import InvalidInput
from scarfmt.formats.inria_ply import DC, ROTATION, SCALES
from scarfmt.formats.output import Described, Losses, Parts, Spool, Written, gaussian_sizes
from scarfmt.formats.ply import PLY_SAYS
from scarfmt.scene.description import Description
from scarfmt.scene.gaussians import GaussianScene


def write_ply(parts: Parts, described: Described, target: BinaryIO) -> Written:
    """Write a scene as PLY. Rows wait on disk where their number is not known before.

    Raises:
        InvalidInput: ``output-comment``.
    """
    rest, count, losses = (described.sh_degree + 1) ** 2 - 1, described.count, Losses()
    comments = [*described.comments, *description_comments(described.description, described.origin)]

    def tables() -> Iterator[F32]:
        for part in parts:
            with np.errstate(over="ignore"):
                far = np.abs(part.positions).max(axis=1).astype(np.float32)
            losses.compare_steps(np.spacing(far).astype(np.float64), gaussian_sizes(part.log_scales))
            yield ply_rows(part)

    if count is not None:
        target.write(ply_header(count, rest, comments))
        for table in tables():
            target.write(table.data)
    else:
        count = 0
        with Spool(("rows",)) as spool:
            for table in tables():
                spool.add("rows", table)
                count += len(table)
            target.write(ply_header(count, rest, comments))
            spool.copy("rows", target)
    return Written(count, losses.notes(described, count, "PLY", PLY_SAYS))


def ply_rows(scene: GaussianScene) -> F32:
    """(N, properties) float32 in the order of :func:`ply_header`, positions rounded, normals zero."""
    rest = 3 * (scene.sh.shape[1] - 1)
    table = np.zeros((len(scene), 17 + rest), "<f4")
    with np.errstate(over="ignore"):  # beyond float32: an infinity says more than a wrong finite number
        table[:, 0:3] = scene.positions
    table[:, 6:9] = scene.sh[:, 0]
    # f_rest is channel-major: all of red, then green, then blue.
    table[:, 9 : 9 + rest].reshape(len(scene), 3, rest // 3)[:] = scene.sh[:, 1:].transpose(0, 2, 1)
    table[:, 9 + rest] = scene.opacity_logits
    table[:, 10 + rest : 13 + rest] = scene.log_scales
    table[:, 13 + rest :] = scene.rotations
    return table


def ply_header(count: int, rest: int, comments: Iterable[str] = ()) -> bytes:
    """The header of a file, binary_little_endian, all float, with normals, as INRIA's trainer writes it.

    Args:
        rest: coefficients of each colour above degree 0.
        comments: printable ASCII, a line each.

    Raises:
        InvalidInput: ``output-comment``.
    """
    lines = ["ply", "format binary_little_endian 1.0"]
    for comment in comments:
        if not comment.isascii() or not comment.isprintable():
            raise InvalidInput("output-comment", f"a PLY comment is one line of printable ASCII, got {comment!r}")
        lines.append(f"comment {comment}")
    names = ["x", "y", "z", "nx", "ny", "nz", *DC, *(f"f_rest_{i}" for i in range(3 * rest)), "opacity"]
    names += [*SCALES, *ROTATION]
    lines += [f"element vertex {count}", *(f"property float {name}" for name in names)]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def description_comments(description: Description, origin: tuple[float, float, float]) -> list[str]:
    """The comments that :func:`scarfmt.formats.ply.describe` understands.

    Args:
        origin: what has to be added to its positions, as written.
    """
    lines = []
    if description.render_model != RenderModel.CLASSIC:
        antialiased = description.render_model == RenderModel.ANTIALIASED
        lines.append(f"SplatRenderMode: {'mip' if antialiased else '2dgs'}")
    if description.up_axis is not None:
        # The bare name y says nothing: Brush writes it whatever is up.
        lines.append(f"Vertical Axis: {'0 1 0' if description.up_axis == 'y' else description.up_axis}")
    if PLY_SAYS.can_name(description.coordinate_reference):
        lines.append(f"epsg {description.coordinate_reference.removeprefix('EPSG:')}")
    if any(origin):
        lines += [f"offset{axis} {number!r}" for axis, number in zip("xyz", origin, strict=True)]
    return lines
