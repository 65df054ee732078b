"""How good a scene looks from everywhere it is judged from (`benchmarks.views`): mean, low end and worst, by kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.scenes import Scene
from benchmarks.views import KINDS, View
from scarfmt.cli.scenes import Subject
from scarfmt.render.compare import compare, compare_with_photos

EQUAL_DB = 100.0
"""PSNR that equal pictures count as, dB."""
PERCENTILE = 5

Judgement = dict[str, Any]


def judgement(original: Subject, other: Subject, views: Sequence[View]) -> Judgement:
    """Pictures of `other` against those of `original`.

    Returns:
        ``psnr_db``, ``p5_psnr_db`` and ``worst_psnr_db``: mean, 5th percentile and least over all views, dB; ``kinds``,
        the mean and the least of each kind there is; ``ssim``, the mean.
    """
    found = compare(original.view, other.view, [view.camera for view in views])
    levels = np.minimum(found.psnr_db, EQUAL_DB)
    return {**summary([view.kind for view in views], levels.tolist()), "ssim": round(found.mean_ssim, 5)}


def summary(kinds: Sequence[str], levels: Sequence[float]) -> Judgement:
    """Figures of views from the PSNR of each, dB."""
    by_kind = {kind: [level for k, level in zip(kinds, levels, strict=True) if k == kind] for kind in KINDS}
    return {
        "psnr_db": round(float(np.mean(levels)), 3),
        "p5_psnr_db": round(float(np.percentile(levels, PERCENTILE)), 3),
        "worst_psnr_db": round(min(levels), 3),
        "kinds": {
            kind: [round(float(np.mean(mine)), 3), round(min(mine), 3)] for kind, mine in by_kind.items() if mine
        },
    }


def photos_psnr_db(scene: Scene, subject: Subject) -> float | None:
    """Mean PSNR against the photos of the capture that were held out, dB; None where there are none."""
    if scene.photos is None:
        return None
    return round(compare_with_photos(subject.view, scene.photos, ssim=False).mean_psnr_db, 3)


def levels_text(found: Judgement) -> str:
    """Mean, 5th percentile and worst, as tables show them."""
    if found["worst_psnr_db"] >= EQUAL_DB:
        return "equal"
    return " / ".join(f"{found[name]:.1f}" for name in ("psnr_db", "p5_psnr_db", "worst_psnr_db"))


def kinds_text(found: Judgement) -> list[str]:
    """Mean and worst of each of :data:`KINDS`; empty where there are none."""
    cells = (found["kinds"].get(kind) for kind in KINDS)
    return ["" if cell is None else f"{cell[0]:.1f} / {cell[1]:.1f}" for cell in cells]


def worst_kind(found: Judgement) -> tuple[str, float]:
    """The kind with the least mean, and that mean, dB."""
    kind = min(found["kinds"], key=lambda kind: float(found["kinds"][kind][0]))
    return kind, float(found["kinds"][kind][0])
