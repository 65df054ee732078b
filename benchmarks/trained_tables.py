"""The tables of docs/trained.md, from what `benchmarks.trained` and `benchmarks.trained_ablations` keep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from benchmarks.photos import HEAD, Figures, cells
from benchmarks.published import published_table
from benchmarks.report import dated, replace_section, table
from benchmarks.scenes import REPOSITORY
from benchmarks.trained_frontier import frontier_table
from benchmarks.trained_plan import BASES, STUDIES, Study, plan_table, training

SCENES, ABLATIONS, PLAN = "trained", "trained-ablations", "trained-plan"
"""Names of results and of sections of the page."""
PAGE = REPOSITORY / "docs" / "trained.md"
BESIDE = {"truck": "truck", "truck-half": "truck", "bonsai": "bonsai"}
"""Published figures by scene; their last column says what they can be compared with."""
KINDS = ("trained", "model", "post-hoc", "rival")
"""What a file is: trained with its rate, trained without, made by `encode` of a model, another format."""
_MOST_SEEDS = 10

Record = dict[str, Any]
Results = dict[str, dict[str, Record]]


def write_scenes(results: Results) -> None:
    """Rewrite what the page says of whole scenes."""
    if results:
        replace_section(SCENES, dated(scene_tables(results), SCENES), PAGE)


def write_ablations(results: Results) -> None:
    """Rewrite what the page says of ablations, and their plan."""
    replace_section(PLAN, plan_table(), PAGE)
    if results:
        replace_section(ABLATIONS, dated(ablation_tables(results), ABLATIONS), PAGE)


def scene_tables(results: Results) -> str:
    """A table of everything that was measured on the photos of each scene."""
    return "\n".join(_scene(name, list(records.values())) for name, records in results.items())


def _scene(name: str, records: Sequence[Record]) -> str:
    ordered = sorted(records, key=lambda record: KINDS.index(record["kind"]))
    width, height = ordered[0]["size"]
    text = f"**{name}**: {ordered[0]['photos']} photos of {width}×{height} held out.\n\n"
    rows = [([_title(it), "–" if it["kind"] == "rival" else str(it["layers"])], it["figures"]) for it in ordered]
    text += _measured(("file", "layers"), rows)
    beside = frontier_table(ordered)
    text += f"\n{beside}" if beside else ""
    return text + (f"\n{published_table(BESIDE[name])}" if name in BESIDE else "")


def _title(record: Record) -> str:
    after = f", {record['iterations']:,} iterations" if record["iterations"] else ""
    return f"{record['name']}{after}"


def _measured(head: Sequence[str], rows: Sequence[tuple[list[str], Record]]) -> str:
    """A table of figures without the columns that nobody measured."""
    lines = [(first, cells(Figures(**figures))) for first, figures in rows]
    kept = [k for k in range(len(HEAD)) if any(line[k] != "–" for _, line in lines)]
    return table((*head, *(HEAD[k] for k in kept)), [[*first, *(line[k] for k in kept)] for first, line in lines])


def ablation_tables(results: Results) -> str:
    """A table of each study of each scene of which two rows were measured."""
    return "\n".join(part for scene, records in results.items() for part in _studies(scene, records))


def _studies(scene: str, records: dict[str, Record]) -> Iterator[str]:
    shown = set()
    for base in BASES:
        for study in STUDIES.values():
            rows = [(row.label, _of_row(study, number, base, records)) for number, row in enumerate(study.rows)]
            found = _same_seeds([(label, mine) for label, mine in rows if mine])
            names = tuple(label for label, _ in found), study.question, *(id(mine[0]) for _, mine in found)
            if len(found) < 2 or names in shown:
                continue
            shown.add(names)
            sizes = found[0][1][0]["size"]
            about = f"{scene}, base `{base}`, {sizes[0]}×{sizes[1]}"
            yield f"**{study.question}** ({about})\n\n" + (_layers(found) if study.by_layer else _ends(found))


def _of_row(study: Study, number: int, base: str, records: dict[str, Record]) -> dict[int, Record]:
    """The result of each seed that was trained."""
    names = {seed: training(study.rows[number], base, {}, seed).name for seed in range(_MOST_SEEDS)}
    return {seed: records[name] for seed, name in names.items() if name in records}


def _same_seeds(found: Sequence[tuple[str, dict[int, Record]]]) -> list[tuple[str, list[Record]]]:
    """The rows, each with the seeds that all of them have: seeds differ by more than rows do."""
    shared = set.intersection(*(set(mine) for _, mine in found)) if found else set()
    return [(label, [mine[seed] for seed in sorted(shared)]) for label, mine in found if shared]


def _ends(found: Sequence[tuple[str, list[Record]]]) -> str:
    """First and last layer of each row: means over seeds, and half of what the last ones differ by."""
    head = ("", "seeds", "first, kB", "dB", "all, kB", "±", "PSNR, dB", "±", "SSIM", "FLIP", "anchors")
    lines = []
    for label, records in found:
        firsts, lasts = [it["layers"][0] for it in records], [it["layers"][-1] for it in records]
        sizes, decibels = [_of(rows, "file_bytes") / 1000 for rows in (firsts, lasts)], _of(lasts, "psnr_db")
        flips = [row["flip"] for row in lasts if row["flip"] is not None]
        cells = [f"{np.mean(sizes[0]):,.1f}", f"{np.mean(_of(firsts, 'psnr_db')):.2f}"]
        spreads = [f"{np.ptp(sizes[1]) / 2:.1f}", f"{np.ptp(decibels) / 2:.2f}"] if len(records) > 1 else ["–", "–"]
        cells += [f"{np.mean(sizes[1]):,.1f}", spreads[0]]
        cells += [f"{np.mean(decibels):.2f}", spreads[1], f"{np.mean(_of(lasts, 'ssim')):.4f}"]
        cells += [f"{np.mean(flips):.4f}" if flips else "–", f"{np.mean([it['anchors'] for it in records]):,.0f}"]
        lines.append([label, str(len(records)), *cells])
    return table(head, lines)


def _of(rows: Sequence[Record], name: str) -> Any:
    return np.array([row[name] for row in rows])


def _layers(found: Sequence[tuple[str, list[Record]]]) -> str:
    """Every layer of each row, means over seeds."""
    lines = []
    for label, records in found:
        for layer in range(min(len(it["layers"]) for it in records)):
            rows = [it["layers"][layer] for it in records]
            means = {key: None if value is None else float(np.mean(_of(rows, key))) for key, value in rows[0].items()}
            lines.append(([label, str(len(records)), str(layer + 1)], means))
    return _measured(("", "seeds", "layers"), lines)
