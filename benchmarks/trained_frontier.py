"""Trained files beside the post-hoc route, at equal PSNR."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from benchmarks.report import table
from benchmarks.scale_loss import bytes_at

Point = tuple[float, float]
"""PSNR in dB, and bytes."""


def frontier(points: Iterable[Point]) -> list[Point]:
    """The lower convex hull of points over the logarithm of bytes, from the fewest bytes to the most dB."""
    least = dict(sorted(points, key=lambda point: point[1], reverse=True))
    hull: list[Point] = []
    for point in sorted(least.items()):
        while len(hull) > 1 and _turn(hull[-2], hull[-1], point) <= 0:
            hull.pop()
        hull.append(point)
    cheapest = min(range(len(hull)), key=lambda k: (hull[k][1], -hull[k][0]), default=0)
    return hull[cheapest:]


def _turn(a: Point, b: Point, c: Point) -> float:
    """Above 0 where the way from a over b to c bends upwards."""
    return (b[0] - a[0]) * math.log(c[1] / b[1]) - math.log(b[1] / a[1]) * (c[0] - b[0])


def reached(hull: Sequence[Point], psnr_db: float) -> float | None:
    """Bytes of a frontier at a PSNR; None where it does not reach."""
    if not hull or not hull[0][0] <= psnr_db <= hull[-1][0]:
        return None
    return bytes_at([{"psnr_db": decibels, "bytes": size} for decibels, size in hull], psnr_db)


def frontier_table(records: Sequence[dict[str, Any]]) -> str:
    """Each layer of trained files, and the bytes of the post-hoc files at its PSNR; empty where there are none."""
    hull = frontier(_point(it) for it in records if it["kind"] == "post-hoc")
    lines = []
    for it in records:
        decibels, size = _point(it)
        other = reached(hull, decibels) if it["kind"] == "trained" else None
        if other is not None:
            layer = [it["name"], str(it["layers"]), f"{decibels:.2f}"]
            lines.append([*layer, f"{size / 1e3:,.1f}", f"{other / 1e3:,.1f}", f"{100 * size / other:.0f} %"])
    return table(("at equal PSNR", "layers", "dB", "kB", "post-hoc, kB", "share"), lines) if lines else ""


def _point(record: dict[str, Any]) -> Point:
    return record["figures"]["psnr_db"], record["figures"]["file_bytes"]
