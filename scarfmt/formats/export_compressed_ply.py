"""Writing PlayCanvas compressed PLY; the layout is in :mod:`scarfmt.formats.compressed_ply`.

Gaussians of a part are put in Morton order, so that the 256 of a chunk lie close together and share tight bounds. All
bounds stand before all vertices, which stand before all harmonics: what is quantised waits aside, and memory does not
grow with the scene but with its largest part.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, U8, U32
from scarfmt.container.morton import MAX_BITS, interleave
from scarfmt.errors import InvalidInput
from scarfmt.formats.aside import Aside
from scarfmt.formats.compressed_ply import CHUNK, CHUNK_BOUNDS, COLOUR_BOUNDS, WORDS
from scarfmt.formats.dequantise import SH_C0
from scarfmt.formats.joined import together
from scarfmt.formats.output import Described, Losses, Parts, Written, finite
from scarfmt.formats.quantise import alpha_of_logit, levels, smallest_three, unit_quaternions
from scarfmt.scene.gaussians import GaussianScene

MAX_LOG_SCALE = 20.0
"""Log scales are written within +-20, as by PlayCanvas: one beyond would coarsen the 255 others of its chunk."""
MAX_HARMONIC = 4.0


def write_compressed_ply(parts: Parts, described: Described, target: BinaryIO) -> Written:
    """Write a compressed PLY, in the axes of the scene.

    Args:
        parts: of the scene; Gaussians are put in order within each.
        described: the scene.
        target: where to.

    Raises:
        InvalidInput: ``output-range``: a value is not finite, or a position too large for float32; ``output-empty``.
    """
    losses, count = Losses(), 0
    with Aside(("chunks", "vertices", "harmonics")) as aside:
        for scene in _whole_chunks(finite(parts, "compressed PLY")):
            bounds, words = _packed(scene, losses)
            aside.add("chunks", bounds)
            aside.add("vertices", words)
            aside.add("harmonics", _harmonics(scene.sh[:, 1:], losses))
            count += len(scene)
        target.write(_header(count, 3 * ((described.sh_degree + 1) ** 2 - 1)))
        for name in ("chunks", "vertices", "harmonics"):
            aside.copy(name, target)
    return Written(count, losses.notes(described, count, colours_of="compressed PLY"))


def _header(count: int, rest: int) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element chunk {-(-count // CHUNK)}"]
    lines += [f"property float {name}" for name in (*CHUNK_BOUNDS, *COLOUR_BOUNDS)]
    lines += [f"element vertex {count}", *(f"property uint {name}" for name in WORDS)]
    if rest:
        lines += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(rest))]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def _whole_chunks(parts: Iterator[GaussianScene]) -> Iterator[GaussianScene]:
    """The Gaussians of all parts, each in Morton order, in scenes of whole chunks; the last chunk may lack some."""
    left: GaussianScene | None = None
    for part in parts:
        ordered = part.take(morton_order(part.positions))
        scene = ordered if left is None else together([left, ordered])
        whole = len(scene) // CHUNK * CHUNK
        if whole:
            yield scene.rows(slice(whole))
        left = scene.rows(slice(whole, None))
    if left is not None and len(left):
        yield left


def morton_order(positions: F64) -> NDArray[np.intp]:
    """(n,) order in which the Gaussians of a part are written."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    step = max(float((high / 2 - low / 2).max()) * 2, 1e-300) / ((1 << MAX_BITS) - 1)
    cells = np.clip((positions - low) / step, 0, (1 << MAX_BITS) - 1)
    return np.argsort(interleave(cells), kind="stable")


def _packed(scene: GaussianScene, losses: Losses) -> tuple[F32, U32]:
    """Bounds (chunks, 18) and words (N, 4)."""
    if np.abs(scene.positions).max() > np.finfo(np.float32).max:
        raise InvalidInput("output-range", "a position is too large for the float32 bounds of a compressed PLY")
    log_scales = scene.log_scales.astype(np.float64)
    losses.count(f"log scales beyond +-{MAX_LOG_SCALE:g}, set to that", np.abs(log_scales) > MAX_LOG_SCALE)
    colours = scene.sh[:, 0].astype(np.float64) * SH_C0 + 0.5
    places = _in_bounds(scene.positions)
    sizes = _in_bounds(np.clip(log_scales, -MAX_LOG_SCALE, MAX_LOG_SCALE))
    shades = _in_bounds(colours)
    red, green, blue = levels(shades[2], 256).T
    alpha = alpha_of_logit(scene.opacity_logits).astype(np.uint32)
    shade = red << np.uint32(24) | green << np.uint32(16) | blue << np.uint32(8) | alpha
    words = np.stack([_11_10_11(places[2]), _rotations(scene.rotations), _11_10_11(sizes[2]), shade], axis=1)
    bounds = np.concatenate([bound for low, high, _ in (places, sizes, shades) for bound in (low, high)], axis=1)
    return bounds.astype("<f4"), words.astype("<u4")


def _in_bounds(values: F64) -> tuple[F64, F64, F64]:
    """Bounds of each chunk, (chunks, 3), as float32 has them, and where each value (N, 3) lies between them, 0..1."""
    starts = np.arange(0, len(values), CHUNK)
    single = values.astype(np.float32)
    low, high = (ends.reduceat(single, starts, axis=0).astype(np.float64) for ends in (np.minimum, np.maximum))
    chunk = np.arange(len(values)) // CHUNK
    span = (high - low)[chunk]
    return low, high, np.where(span > 0, (values - low[chunk]) / np.where(span > 0, span, 1.0), 0.0)


def _11_10_11(fractions: F64) -> U32:
    x, y, z = fractions.T
    return levels(x, 2048) << np.uint32(21) | levels(y, 1024) << np.uint32(11) | levels(z, 2048)


def _rotations(quaternions: F32) -> U32:
    kept, omitted = smallest_three(unit_quaternions(quaternions))
    a, b, c = levels(kept * np.sqrt(0.5) + 0.5, 1024).T
    return np.asarray(omitted.astype(np.uint32) << np.uint32(30) | a << np.uint32(20) | b << np.uint32(10) | c)


def _harmonics(rest: F32, losses: Losses) -> U8:
    """(N, 3, R) bytes, red first: the 256 bins of -4..4."""
    losses.count(f"spherical harmonics beyond +-{MAX_HARMONIC:g}, set to that", np.abs(rest) > MAX_HARMONIC)
    bins = np.floor((rest.transpose(0, 2, 1).astype(np.float64) / (2 * MAX_HARMONIC) + 0.5) * 256)
    return np.clip(bins, 0, 255).astype(np.uint8)
