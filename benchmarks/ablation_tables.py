"""The tables of docs/ablations.md, from the records that `benchmarks.ablation` keeps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from benchmarks.report import dated, replace_section, table
from benchmarks.scenes import REPOSITORY

NAME = "ablation"
PAGE = REPOSITORY / "docs" / "ablations.md"
Record = dict[str, Any]
Records = Sequence[Record]


def texts(results: dict[str, Any]) -> dict[str, str]:
    """Markdown of every study with results."""
    found = {}
    for study, text in STUDIES.items():
        mine = [record for record in results.get(study, {}).values() if "failed" not in record]
        parts = [text([r for r in mine if r["full"] is full]) for full in (False, True)]
        titles = "", "With `--full`:\n\n"
        shown = [title + part for title, part in zip(titles, parts, strict=True) if part]
        if shown:
            found[study] = "\n\n".join(shown)
    return found


def write_page(results: dict[str, Any]) -> None:
    """Rewrite all tables of the page."""
    for study, text in texts(results).items():
        replace_section(study, dated(text, NAME, section=f"{study}/"), PAGE)


def seeds(records: Records, variant: str) -> Records:
    """The records of a variant, one a seed."""
    return [record for record in records if record["variant"] == variant]


def names(records: Records, field: str) -> list[str]:
    """Different values of a field, in the order of the records."""
    return list(dict.fromkeys(record[field] for record in records))


def mean(records: Records, field: str) -> float:
    """Mean of a field over seeds; NaN where it is missing."""
    values = [record[field] for record in records if record.get(field) is not None]
    return float(np.mean(values)) if values else float("nan")


def spread(values: Sequence[float]) -> float:
    """Half the distance between the largest and the least; NaN of fewer than two."""
    return (max(values) - min(values)) / 2 if len(values) > 1 else float("nan")


def number(value: float, form: str) -> str:
    """`value` in the format `form`, empty where there is none."""
    return format(value, form) if np.isfinite(value) else ""


def common_points(curves: Iterable[dict[str, float]], count: int = 3) -> list[str]:
    """About `count` abscissae, spread over those that all curves have."""
    shared = sorted(set.intersection(*(set(curve) for curve in curves)), key=float)
    places = np.linspace(0, len(shared) - 1, min(count, len(shared)) + 2)[1:-1]
    return [shared[round(place)] for place in places] if shared else []


def per_scene(draw: Callable[[Records], str], sized: bool = True) -> Callable[[Records], str]:
    """A text of one table a scene, each under its name, with the size of the sample if that is one for all rows."""

    def text(records: Records) -> str:
        parts = []
        for scene in sorted(names(records, "scene")):
            mine = [record for record in records if record["scene"] == scene]
            parts += [f"**{scene}**{_sample(mine) if sized else ''}", draw(mine)]
        return "\n\n".join(parts)

    return text


def _sample(records: Records) -> str:
    for record in records:
        if "held" in record:
            sizes = f"{record['rows']:,} rows to train on, {record['epochs']} epochs, {record['held']:,} rows held out"
            return f": {record['symbols']:,} indices in the scene; {sizes}."
    return "."


def _entropy_table(records: Records, order: Sequence[str], base: str) -> str:
    """Variants of the entropy model, all coding the same indices."""
    head = (
        "variant",
        "bits/index, trained on",
        "bits/index, held out",
        "models, bytes",
        "all, bytes",
        "± seeds",
        "",
        "s",
    )
    start = mean(seeds(records, base), "bytes")
    rows = []
    for variant in order:
        found = seeds(records, variant)
        if not found:
            continue
        total = mean(found, "bytes")
        models = mean(found, "model_bytes") + np.nan_to_num(mean(found, "grid_bytes"))
        rows.append(
            (
                variant,
                number(mean(found, "in_sample"), ".3f"),
                number(mean(found, "held_out"), ".3f"),
                number(models, ",.0f"),
                number(total, ",.0f"),
                number(spread([record["bytes"] for record in found]), ",.0f"),
                number(100 * (total / start - 1), "+.1f") + " %",
                number(mean(found, "seconds"), ".0f"),
            )
        )
    return table(head, rows)


def _context(records: Records) -> str:
    order = ("static tables", "MLP", "branched MLP", "GRU, no spatial input", "GRU", "GRU + attention")
    return _entropy_table(records, order, "static tables")


def _spatial(records: Records) -> str:
    order = ("none", "3D grid", "hybrid grid", "fixed waves", "decoded", "decoded + waves", "decoded + hybrid grid")
    return _entropy_table(records, order, "none")


def _quantiser(records: Records) -> str:
    head = [
        *("quantiser", "indices", "static tables, B", "network, B", "codebooks, B", "whole file, B", "PSNR dB"),
        *("latent error", "file + error at lambda, B"),
    ]
    order = sorted(names(records, "variant"))
    least = min((r["latent_error"] for r in records), default=1.0)
    rows = []
    for (record,) in (seeds(records, variant) for variant in order):
        priced = record["file_bytes"] + (record["latent_error"] - least) / record["rate"] / 8
        counts = [f"{record[f]:,.0f}" for f in ("symbols", "static_bytes", "bytes", "codebook_bytes", "file_bytes")]
        quality = f"{record['psnr_db']:.2f}", f"{record['latent_error'] / least:.3f}", f"{priced:,.0f}"
        rows.append((record["variant"], *counts, *quality))
    return table(head, rows)


def _estimator(records: Records) -> str:
    head = ("scene", "estimator", "bits: dB, both seeds", "floor, dB", "s")
    rows = []
    for scene in sorted(names(records, "scene")):
        mine = [record for record in records if record["scene"] == scene]
        points = common_points(record["decibels"] for record in mine)
        for variant in ("rotation", "straight-through"):
            found = seeds(mine, variant)
            cells = (f"{p}: " + " / ".join(f"{r['decibels'][p]:.2f}" for r in found) for p in points)
            floor, seconds = number(mean(found, "floor_db"), ".1f"), number(mean(found, "seconds"), ".0f")
            rows.append((scene, variant, "; ".join(cells), floor, seconds))
    return table(head, rows, text_columns=3) if rows else ""


def _network(records: Records) -> str:
    head = ("network", "bytes, estimated", "bytes, packed", "bits/index, integers", "float", "", "all, bytes", "", "s")
    base = mean(seeds(records, "H 16"), "bytes")
    rows = []
    for variant in (v for v in names(records, "variant") if not v.endswith(", float")):
        (record,) = seeds(records, variant)
        alike = seeds(records, f"{variant}, float") or seeds(records, "H 16, float")
        smooth = mean(alike, "held_out")
        rows.append(
            (
                variant,
                number(record["model_bytes"], ",.0f"),
                f"{record['packed_bytes']:,}",
                number(record["held_out"], ".3f"),
                number(smooth, ".3f"),
                number(100 * (record["held_out"] / smooth - 1), "+.1f") + " %",
                number(record["bytes"], ",.0f"),
                number(100 * (record["bytes"] / base - 1), "+.1f") + " %",
                number(record["seconds"], ".0f"),
            )
        )
    return table(head, sorted(rows, key=_by_family))


def _by_family(row: Sequence[str]) -> tuple[int, int]:
    """Heads, widths, weights, activations; each by size."""
    family, _, size = row[0].rpartition(" ")
    return ("flat", "H", "weights", "activations").index(family), int(size) if size.isdigit() else 0


STUDIES: dict[str, Callable[[Records], str]] = {
    "context": per_scene(_context),
    "spatial": per_scene(_spatial),
    "quantiser": per_scene(_quantiser, sized=False),
    "estimator": _estimator,
    "network": per_scene(_network),
}
