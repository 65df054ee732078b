"""Scenes written in the formats of others and read back: bytes, what pictures lose, and time against a PLY.

    python -m benchmarks.interchange [--scenes NAME ...] [--short] [--no-write]

The source is written as it is, not as a .scar file decodes. Pictures of what is read back are compared with pictures of
the source, from the views that all benchmarks judge from. All formats take turns in writing and in reading to memory;
a time is the median over the turns of the time by that of a PLY in the same turn.
"""

from __future__ import annotations

import argparse
import io
import statistics
import time
from functools import partial
from typing import Any, NamedTuple

from benchmarks.judged import judgement, levels_text
from benchmarks.report import add_arguments, dated, load_results, replace_section, save_results, table
from benchmarks.scenes import REPOSITORY, Scene, chosen
from scarfmt.cli.scenes import Subject
from scarfmt.formats import load
from scarfmt.formats.export_spz import SpzOptions
from scarfmt.formats.output import Described
from scarfmt.formats.outputs import OutputOptions, write_parts
from scarfmt.scene.gaussians import GaussianScene

NAME = "interchange"
PAGE = REPOSITORY / "docs" / "formats-in-and-out.md"
DEFAULT_SCENES = ("plush-on-bed",)
TURNS = 3


class Setting(NamedTuple):
    """A format, how it is written, and what tables call that."""

    title: str
    format_id: str
    spz: SpzOptions = SpzOptions()


SETTINGS = (
    Setting("PLY", "ply"),
    Setting("glTF, `.glb`", "glb"),
    Setting("compressed PLY", "compressed-ply"),
    Setting("SPZ 4", "spz"),
    Setting("SPZ 3", "spz", SpzOptions(3)),
    Setting("SPZ 4, steps of Niantic's library: 2^-12", "spz", SpzOptions(4, 12)),
    Setting("SPZ 4, SH 8 and 8 bits", "spz", SpzOptions(4, None, (8, 8))),
)


def measure(scene: Scene) -> dict[str, Any]:
    """Write and read a scene in every setting.

    Returns:
        ``count``, ``sh_degree``; ``formats``, of each setting its title, ``bytes``, the figures of `judgement`, notes
        of the writer, and ``write`` and ``read``, times by those of a PLY; ``ply_seconds`` of writing and reading that.
    """
    source = _explicit(load(scene.path))
    original = Subject(source, source).remembering()
    views = scene.judged_views(original)
    seconds = [_turn(source) for _ in range(TURNS)]
    rows = []
    for number, setting in enumerate(SETTINGS):
        data, notes = _written(source, setting)
        back = _explicit(load(data))
        ratios = [statistics.median(turn[number][k] / turn[0][k] for turn in seconds) for k in (0, 1)]
        rows.append(
            {
                "title": setting.title,
                "bytes": len(data),
                **judgement(original, Subject(back, back), views),
                "notes": list(notes),
                "write": round(ratios[0], 2),
                "read": round(ratios[1], 2),
            }
        )
    plain = [round(statistics.median(turn[0][k] for turn in seconds), 3) for k in (0, 1)]
    return {"count": len(source), "sh_degree": source.sh_degree, "ply_seconds": plain, "formats": rows}


def _turn(scene: GaussianScene) -> list[tuple[float, float]]:
    """Seconds of writing and of reading, in every setting once."""
    found = []
    for setting in SETTINGS:
        start = time.perf_counter()
        data, _ = _written(scene, setting)
        written = time.perf_counter()
        load(data)
        found.append((written - start, time.perf_counter() - written))
    return found


def _written(scene: GaussianScene, setting: Setting) -> tuple[bytes, tuple[str, ...]]:
    out = io.BytesIO()
    done = write_parts(setting.format_id, [scene], Described(scene.sh_degree), out, OutputOptions(setting.spz))
    return out.getvalue(), done.notes


def _explicit(scene: object) -> GaussianScene:
    assert isinstance(scene, GaussianScene)
    return scene


def markdown(results: dict[str, Any]) -> str:
    """The tables of the page, one for each scene."""
    head = ["format", "bytes", "a Gaussian", "PSNR dB: mean / 5th percentile / worst", "write", "read"]
    parts = []
    for name, found in results.items():
        rows = []
        for row in found["formats"]:
            each = f"{row['bytes'] / found['count']:.1f}"
            times = [f"{row[what]:.1f}" for what in ("write", "read")]
            rows.append([row["title"], f"{row['bytes']:,}", each, levels_text(row), *times])
        write, read = found["ply_seconds"]
        title = f"{name}: {found['count']:,} Gaussians, SH {found['sh_degree']}"
        parts.append(f"{title}; a PLY takes {write} s to write and {read} s to read.\n\n{table(head, rows)}")
    return "\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    arguments = parser.parse_args()
    results = {} if arguments.no_write else load_results(NAME)
    names = []
    for scene in chosen(arguments.scenes or (["plush-toys"] if arguments.short else DEFAULT_SCENES)):
        results[scene.name] = measure(scene)
        names.append(scene.name)
    save_results(NAME, results, not arguments.no_write, names)
    show = print if arguments.no_write else partial(replace_section, NAME, page=PAGE)
    show(dated(markdown(results), NAME, not arguments.no_write))


if __name__ == "__main__":
    main()
