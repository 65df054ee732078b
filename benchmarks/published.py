"""Figures that other methods published, to stand beside those of :mod:`benchmarks.photos`.

Those of single scenes are from the tables of 3dgs-compression-survey (2025-04-29), those of SCAR-GS from its paper,
those of PCGS read off its figures. Whoever trains on the same photos at the same size, every 8th held out, may compare;
others only see the order of magnitude.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.report import table


@dataclass(frozen=True)
class Published:
    """One operating point.

    Attributes:
        method: with its setting.
        megabytes: 10^6 bytes.
        psnr_db: mean over the held-out photos.
        photos: which they are and how large.
    """

    method: str
    megabytes: float
    psnr_db: float
    photos: str


_FULL, _BONSAI = "251 photos at 979x546", "292 photos at half size, larger than ours"
_MEAN = "mean of the 9 scenes of Mip-NeRF 360"
PUBLISHED: dict[str, tuple[Published, ...]] = {
    "truck": (
        Published("HAC++ low", 5.94, 25.89, _FULL),
        Published("HAC++ high", 8.01, 26.06, _FULL),
        Published("HAC low", 9.71, 25.88, _FULL),
        Published("HAC high", 13.02, 26.02, _FULL),
        Published("ContextGS low", 13.11, 25.85, _FULL),
        Published("ContextGS high", 13.70, 26.05, _FULL),
    ),
    "bonsai": (
        Published("HAC++ low", 5.62, 32.66, _BONSAI),
        Published("HAC++ high", 11.69, 33.17, _BONSAI),
    ),
    "mip-nerf-360": (
        Published("SCAR-GS, layer 1", 11.71, 25.20, _MEAN),
        Published("SCAR-GS, layer 2", 13.54, 26.54, _MEAN),
        Published("SCAR-GS, layer 3", 15.36, 27.09, _MEAN),
        Published("SCAR-GS, layer 4", 19.73, 27.27, _MEAN),
        Published("PCGS, point 1", 12.3, 27.81, _MEAN),
        Published("PCGS, point 2", 16.2, 27.93, _MEAN),
        Published("PCGS, point 3", 20.6, 27.955, _MEAN),
    ),
}
SCENES = tuple(PUBLISHED)


def published_table(scene: str) -> str:
    """The operating points of a scene, or of a set of scenes, in Markdown."""
    rows = [(it.method, f"{it.megabytes:.2f}", f"{it.psnr_db:.2f}", it.photos) for it in PUBLISHED[scene]]
    return table(("published", "MB", "PSNR, dB", "comparable with"), rows)
