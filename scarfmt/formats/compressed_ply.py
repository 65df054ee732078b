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

import numpy as np
from numpy.typing import NDArray

from scarfmt.arrays import F32, F64
from scarfmt.formats import ply, ply_body
from scarfmt.formats.dequantise import complete_smallest_three, dc_of_colour, logit_of_alpha, sh_from_channel_major
from scarfmt.formats.source import Source
from scarfmt.scene.gaussians import GaussianScene

CHUNK = 256

WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
CHUNK_BOUNDS = tuple(f"{end}_{what}{axis}" for what in ("", "scale_") for end in ("min", "max") for axis in "xyz")
COLOUR_BOUNDS = ("min_r", "min_g", "min_b", "max_r", "max_g", "max_b")


def sniff(source: Source) -> bool:
    """Whether the content is a PLY file with packed vertices."""
    return ply.is_ply(source) and b"packed_position" in source.head(4096)


def load(source: Source) -> GaussianScene:
    """Read a PlayCanvas compressed PLY.

    Raises:
        InvalidInput: damaged, or not this layout.
        LimitExceeded: more rows than any scene has.
    """
    header = ply.read_header(source)
    rest = _check_layout(source, header)
    elements = ply_body.read_elements(source, header, ["chunk", "vertex", "sh"] if rest else ["chunk", "vertex"])
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
            np.concatenate([dc_of_colour(colour), _harmonics(elements, rest)], axis=1),
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
    return ply_body.columns(chunk, [f"{end}_{what}{axis}" for axis in axes]).astype(np.float64)


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


def _harmonics(elements: dict[str, NDArray[np.void]], rest: list[str]) -> F32:
    if not rest:
        return np.empty((len(elements["vertex"]), 0, 3), np.float32)
    levels = (np.arange(256) + 0.5) / 256
    levels[[0, 255]] = 0.0, 1.0
    stored = np.stack([elements["sh"][name] for name in rest], axis=1)
    return sh_from_channel_major(((levels - 0.5) * 8.0)[stored])
