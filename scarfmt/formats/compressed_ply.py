"""PlayCanvas compressed PLY: chunks of 256 Gaussians share bounds, each Gaussian is four packed 32-bit words.

Layout (PlayCanvas user manual, "Compressed PLY format"):

- ``chunk``: float min/max of position, log scale and, in newer files, colour.
- ``vertex.packed_position``, ``packed_scale``: x 11, y 10, z 11 bits (x highest), linear in the chunk's bounds.
- ``packed_rotation``: 2 bits name the omitted largest of w, x, y, z; then three 10-bit components of
  [-sqrt(1/2), sqrt(1/2)].
- ``packed_color``: red, green, blue in the chunk's bounds, then opacity, 8 bits each (red highest).
- ``sh.f_rest_*`` (optional): uchar, channel-major; 0 and 255 are -4 and 4, others the middle of 1/256 bins.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64, U8, U32, Floats
from scarfmt.container.morton import MAX_BITS, interleave
from scarfmt.errors import InvalidInput, Unsupported
from scarfmt.formats import ply
from scarfmt.formats.export_ply import description_comments
from scarfmt.formats.output import Described, Losses, Parts, Spool, Written, finite, gaussian_sizes
from scarfmt.formats.quantise import (
    SH_C0,
    alpha_of_logit,
    complete_smallest_three,
    dc_of_colour,
    levels,
    logit_of_alpha,
    sh_from_channel_major,
    smallest_three,
    unit_quaternions,
)
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene, concatenate

CHUNK = 256

WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
CHUNK_BOUNDS = tuple(f"{end}_{what}{axis}" for what in ("", "scale_") for end in ("min", "max") for axis in "xyz")
COLOUR_BOUNDS = ("min_r", "min_g", "min_b", "max_r", "max_g", "max_b")


describe = ply.describe


def sniff(source: Source) -> bool:
    """Whether the content is a PLY file with packed vertices."""
    if not ply.is_ply(source):
        return False
    try:
        vertex = ply.read_header(source).elements.get("vertex")
    except (InvalidInput, Unsupported):
        return False
    return vertex is not None and WORDS[0] in vertex.properties


def load(source: Source) -> GaussianScene:
    """Read a PlayCanvas compressed PLY.

    Raises:
        InvalidInput: damaged, or not this layout.
        LimitExceeded: more rows than any scene has.
    """
    header = ply.read_header(source)
    rest = _check_layout(source, header)
    elements = ply.read_elements(source, header, ["chunk", "vertex", "sh"] if rest else ["chunk", "vertex"])
    vertex, chunk = elements["vertex"], elements["chunk"]
    of_chunk = np.arange(len(vertex)) // CHUNK
    low, high = (_bounds(chunk, end, "", "xyz")[of_chunk] for end in ("min", "max"))
    scale_low, scale_high = (_bounds(chunk, end, "scale_", "xyz")[of_chunk] for end in ("min", "max"))
    colour, alpha = _unpack_colour(vertex["packed_color"])
    if "min_r" in header.elements["chunk"].properties:
        darkest, brightest = (_bounds(chunk, end, "", "rgb")[of_chunk] for end in ("min", "max"))
        colour = _between(darkest, brightest, colour)
    with np.errstate(all="ignore"):  # damaged bounds give non-finite values, which a later check reports
        return GaussianScene(
            _between(low, high, _unpack_11_10_11(vertex["packed_position"])),
            _between(scale_low, scale_high, _unpack_11_10_11(vertex["packed_scale"])).astype(np.float32),
            _unpack_rotation(vertex["packed_rotation"]),
            logit_of_alpha(alpha),
            sh_from_channel_major(dc_of_colour(colour)[:, 0], _harmonics(elements, rest)),
        )


def _check_layout(source: Source, header: ply.Header) -> list[str]:
    """Check elements, types and counts; the names of the SH columns."""
    vertex, chunk, sh = (header.elements.get(name, ply.Element(name, 0)) for name in ("vertex", "chunk", "sh"))
    bounds = CHUNK_BOUNDS + (COLOUR_BOUNDS if "min_r" in chunk.properties else ())
    if any(vertex.properties.get(name) not in ("uint", "uint32") for name in WORDS):
        raise source.corrupt(f"a compressed PLY needs the uint properties {', '.join(WORDS)}", field="vertex")
    if any(chunk.properties.get(name) not in ("float", "float32") for name in bounds):
        raise source.corrupt(f"a compressed PLY needs the float properties {', '.join(bounds)}", field="chunk")
    if chunk.count * CHUNK < vertex.count:
        raise source.corrupt(f"{chunk.count} chunks of {CHUNK} for {vertex.count} Gaussians", field="chunk")
    rest = [f"f_rest_{i}" for i in range(len(sh.properties))]
    uchar = all(sh.properties.get(name) in ("uchar", "uint8") for name in rest)
    if len(rest) not in (0, 9, 24, 45) or not uchar or (rest and sh.count != vertex.count):
        raise source.corrupt(f"expected {vertex.count} rows of 9, 24 or 45 uchar f_rest properties", field="sh")
    return rest


def _bounds(chunk: NDArray[np.void], end: str, what: str, axes: str) -> F64:
    return ply.columns(chunk, [f"{end}_{what}{axis}" for axis in axes]).astype(np.float64)


def _between(low: F64, high: F64, fraction: F64) -> F64:
    return low * (1.0 - fraction) + high * fraction


def _field(words: NDArray[np.uint32], shift: int, bits: int) -> F64:
    """Bits [shift, shift + bits) of each word as a fraction 0..1."""
    top = (1 << bits) - 1
    return ((words >> np.uint32(shift)) & np.uint32(top)).astype(np.float64) / top


def _unpack_11_10_11(words: NDArray[np.uint32]) -> F64:
    return np.stack([_field(words, 21, 11), _field(words, 11, 10), _field(words, 0, 11)], axis=1)


def _unpack_rotation(words: NDArray[np.uint32]) -> F32:
    kept = np.stack([_field(words, shift, 10) for shift in (20, 10, 0)], axis=1)
    quaternions = complete_smallest_three((kept - 0.5) * np.sqrt(2.0), words >> np.uint32(30))
    return quaternions.astype(np.float32)


def _unpack_colour(words: NDArray[np.uint32]) -> tuple[F64, NDArray[np.uint8]]:
    colour = np.stack([_field(words, shift, 8) for shift in (24, 16, 8)], axis=1)
    return colour, (words & np.uint32(255)).astype(np.uint8)


def _harmonics(elements: dict[str, NDArray[np.void]], rest: list[str]) -> Floats:
    if not rest:
        return np.empty((len(elements["vertex"]), 0), np.float32)
    levels = (np.arange(256) + 0.5) / 256
    levels[[0, 255]] = 0.0, 1.0
    stored = np.stack([elements["sh"][name] for name in rest], axis=1)
    return np.asarray(((levels - 0.5) * 8.0)[stored])


MAX_LOG_SCALE = 20.0
"""Log scales are written within +-20, as by PlayCanvas: one beyond would coarsen the 255 others of its chunk."""
MAX_HARMONIC = 4.0


def write_compressed_ply(parts: Parts, described: Described, target: BinaryIO) -> Written:
    """Write a compressed PLY, in the axes of the scene.

    Args:
        parts: of the scene; Gaussians are put in order within each.

    Raises:
        InvalidInput: ``output-range``: a value is not finite, or a position too large for float32; ``output-empty``.
    """
    losses, count = Losses(), 0
    with Spool(("chunks", "vertices", "harmonics")) as spool:
        for scene in _whole_chunks(finite(parts, "compressed PLY")):
            bounds, words = _pack(scene, losses)
            spool.add("chunks", bounds)
            spool.add("vertices", words)
            spool.add("harmonics", _pack_harmonics(scene.sh[:, 1:], losses))
            count += len(scene)
        losses.refuse_coarse("compressed PLY", "leave out Gaussians far from all others, or write another format")
        comments = description_comments(described.description, described.origin)
        target.write(_header(count, 3 * ((described.sh_degree + 1) ** 2 - 1), comments))
        for name in ("chunks", "vertices", "harmonics"):
            spool.copy(name, target)
    notes = losses.notes(described, count, "compressed PLY", ply.PLY_SAYS)
    return Written(count, (_GRID, *notes))


_GRID = (
    f"compressed PLY rounds positions, scales and colours to 1/2047 to 1/255 of their range in each {CHUNK} Gaussians,"
    " opacities to 1/255, spherical harmonics to 1/32, and changes the order"
)


def _header(count: int, rest: int, comments: list[str]) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {line}" for line in comments)]
    lines.append(f"element chunk {-(-count // CHUNK)}")
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
        scene = ordered if left is None else concatenate([left, ordered])
        whole = len(scene) // CHUNK * CHUNK
        if whole:
            yield scene.rows(slice(whole))
        left = scene.rows(slice(whole, None))
    if left is not None and len(left):
        yield left


def morton_order(positions: F64) -> NDArray[np.intp]:
    """(n,) order in which the Gaussians of a part are written."""
    # A few that lie far from all others would leave those one cell.
    low, high = np.percentile(positions, [2, 98], axis=0)
    step = max(float((high / 2 - low / 2).max()) * 2, 1e-300) / ((1 << MAX_BITS) - 1)
    cells = np.clip((positions - low) / step, 0, (1 << MAX_BITS) - 1)
    return np.argsort(interleave(cells), kind="stable")


def _pack(scene: GaussianScene, losses: Losses) -> tuple[F32, U32]:
    """Bounds (chunks, 18) and words (N, 4)."""
    if np.abs(scene.positions).max() > np.finfo(np.float32).max:
        raise InvalidInput("output-range", "a position is too large for the float32 bounds of a compressed PLY")
    log_scales = scene.log_scales.astype(np.float64)
    losses.count(f"log scales beyond +-{MAX_LOG_SCALE:g}, set to that", np.abs(log_scales) > MAX_LOG_SCALE)
    colours = scene.sh[:, 0].astype(np.float64) * SH_C0 + 0.5
    places = _in_bounds(scene.positions)
    chunk = np.arange(len(scene)) // CHUNK
    steps = ((places[1] - places[0]) / (2047, 1023, 2047)).max(axis=1)[chunk]
    losses.compare_steps(steps, gaussian_sizes(scene.log_scales))
    sizes = _in_bounds(np.clip(log_scales, -MAX_LOG_SCALE, MAX_LOG_SCALE))
    shades = _in_bounds(colours)
    red, green, blue = levels(shades[2], 256).T
    alpha = alpha_of_logit(scene.opacity_logits).astype(np.uint32)
    shade = red << np.uint32(24) | green << np.uint32(16) | blue << np.uint32(8) | alpha
    words = np.stack(
        [_pack_11_10_11(places[2]), _pack_rotations(scene.rotations), _pack_11_10_11(sizes[2]), shade], axis=1
    )
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


def _pack_11_10_11(fractions: F64) -> U32:
    x, y, z = fractions.T
    return levels(x, 2048) << np.uint32(21) | levels(y, 1024) << np.uint32(11) | levels(z, 2048)


def _pack_rotations(quaternions: F32) -> U32:
    kept, omitted = smallest_three(unit_quaternions(quaternions))
    a, b, c = levels(kept * np.sqrt(0.5) + 0.5, 1024).T
    return np.asarray(omitted.astype(np.uint32) << np.uint32(30) | a << np.uint32(20) | b << np.uint32(10) | c)


def _pack_harmonics(rest: F32, losses: Losses) -> U8:
    """(N, 3, R) bytes, red first: the 256 bins of -4..4."""
    losses.count(f"spherical harmonics beyond +-{MAX_HARMONIC:g}, set to that", np.abs(rest) > MAX_HARMONIC)
    bins = np.floor((rest.transpose(0, 2, 1).astype(np.float64) / (2 * MAX_HARMONIC) + 0.5) * 256)
    return np.clip(bins, 0, 255).astype(np.uint8)
