"""Writing a scene as the PLY every Gaussian splatting viewer opens."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from typing import BinaryIO

import numpy as np

from scarfmt.arrays import F32
from scarfmt.atomic import atomic_write
from scarfmt.errors import InvalidInput
from scarfmt.scene.gaussians import GaussianScene


def write_inria_ply(
    scene: GaussianScene,
    destination: str | PathLike[str] | BinaryIO,
    *,
    comments: Iterable[str] = (),
    force: bool = False,
) -> None:
    """Write INRIA's layout, binary_little_endian, all float: x y z nx ny nz f_dc f_rest opacity scale rot.

    Values are as in the scene, bit for bit; positions are rounded to float32. Normals are zero, as INRIA writes them.

    Args:
        scene: any scene.
        destination: a path, written whole or not at all, or an open binary file.
        comments: header comment lines, ASCII, one line each.
        force: overwrite an existing file.

    Raises:
        InvalidInput: the file exists and `force` is not set, or a comment cannot be written.
    """
    rows = ply_rows(scene)
    header = ply_header(len(scene), property_names(scene.sh.shape[1] - 1), comments)
    if isinstance(destination, str | PathLike):
        with atomic_write(destination, force=force) as stream:
            stream.write(header)
            stream.write(rows.data)
    else:
        destination.write(header)
        destination.write(rows.data)


def property_names(rest: int) -> list[str]:
    """INRIA's columns for `rest` coefficients a colour above degree 0."""
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
    names += [f"f_rest_{i}" for i in range(3 * rest)]
    return [*names, "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]


def ply_rows(scene: GaussianScene) -> F32:
    """(N, properties) little-endian float32, in the order of the header."""
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


def ply_header(count: int, names: list[str], comments: Iterable[str]) -> bytes:
    """The header of `count` Gaussians with properties `names`.

    Raises:
        InvalidInput: ``output-comment``.
    """
    lines = ["ply", "format binary_little_endian 1.0"]
    for comment in comments:
        if not comment.isascii() or not comment.isprintable():
            raise InvalidInput("output-comment", f"a PLY comment is one line of printable ASCII, got {comment!r}")
        lines.append(f"comment {comment}")
    lines.append(f"element vertex {count}")
    lines += [f"property float {name}" for name in names]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")
