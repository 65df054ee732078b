"""The generated parts of SPEC.md and SPEC-neural.md.

``python -m conformance.spec.spec_tables [--write]``

A part stands between the lines ``<!-- table:NAME -->`` and ``<!-- end -->``. Without ``--write`` the script only says
which parts are stale, and fails if any are; tests/conformance/spec/test_spec.py does the same.
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Callable
from functools import partial
from pathlib import Path

from scarfmt_conformance.archive import read

from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.work import Work
from conformance.spec.spec_text import NEURAL, SPEC
from conformance.spec.worked import rans_text, tour_text, value_text, worked_file
from conformance.spec.worked_network import evaluation_rows, network_rows, table_text
from scarfmt.blocks.codebooks import CODEBOOKS
from scarfmt.blocks.declare import Record
from scarfmt.blocks.hash_grid import HASH_GRID
from scarfmt.blocks.index_network import ENTROPY_NETWORK, LINEAR, MATRIX
from scarfmt.blocks.layer import LAYER
from scarfmt.blocks.listing import listing
from scarfmt.blocks.mlp import NETWORKS
from scarfmt.blocks.predictors import LAYER_OF_PREDICTOR, PREDICTORS
from scarfmt.blocks.registry import BLOCKS
from scarfmt.blocks.streaming import STREAMING
from scarfmt.blocks.tables import TABLES
from scarfmt.container.schema import STRUCTURES, BlockKind, markdown_table
from scarfmt.neural import tables
from scarfmt.scene.streams import channel_table

PAGES = (SPEC, NEURAL)
_WORK_OF = ("worked", "valid/explicit-refined", "valid/predictors", "valid/index-deep", "valid/anchors-neural")
_HEADING = re.compile(r"^(#{2,3}) (.+)$", re.MULTILINE)
_FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
_WIDTH = 120
_PART = re.compile(r"<!-- table:([\w-]+) -->\n(.*?)<!-- end -->\n", re.DOTALL)


def slug(heading: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def contents(text: str) -> str:
    """A list of links to the chapters of `text`, each followed by the titles of its sections."""
    lines: list[str] = []
    for depth, title in _HEADING.findall(_FENCE.sub("", text)):
        if len(depth) == 2:
            lines.append(f"- [{title}](#{slug(title)})")
        else:
            lines[-1] += f"{' ·' if ': ' in lines[-1] else ':'} {title}"
    return "".join(textwrap.fill(line, _WIDTH, subsequent_indent="  ") + "\n" for line in lines[1:])


def _work_values() -> str:
    """work(k) at the last layer of some vectors, in its four parts."""
    lines = ["| vector | k | models | splits | tiles | anchors | an anchor | work(k) |", f"|---|{'---:|' * 7}"]
    for id_ in _WORK_OF:
        work = Work(Decoder(read(id_)))
        parts = work.parts()
        lines.append(f"| `{id_}` | {' | '.join(map(str, (work.k, *parts, parts.total)))} |")
    return "\n".join(lines) + "\n"


def _block_kinds() -> str:
    """The table of §16.5: each kind, what `count` means in the directory, and the section."""
    rows = [(spec.kind, spec.elements, spec.section) for spec in BLOCKS.values() if spec.kind < BlockKind.TILE]
    rows += [(BlockKind.TILE, "anchors", "7.1"), (BlockKind.METADATA, "0", BLOCKS[BlockKind.METADATA].section)]
    rows += [(spec.kind, spec.elements, spec.section) for spec in BLOCKS.values() if spec.kind > BlockKind.METADATA]
    lines = ["| value | name | `count` | section |", "|---|---|---|---|"]
    lines += [f"| {int(kind)} | `{kind.name}` | {count} | {section} |" for kind, count, section in rows]
    return "\n".join(lines) + "\n"


def _numbers(values: tuple[int, ...]) -> str:
    """Sixteen numbers a line, in a code block."""
    lines = [" ".join(f"{v:5}" for v in values[start : start + 16]) for start in range(0, len(values), 16)]
    return "\n".join(["```", *lines, "```", ""])


def layouts() -> dict[str, Callable[[], str]]:
    """The layouts of model blocks, from their declarations."""
    declared: dict[str, list[tuple[str, Record]]] = {
        "CODEBOOKS": [("codebooks_block()", CODEBOOKS)],
        "NETWORKS": [("networks()", NETWORKS)],
        "LAYER": [("layer_block(layer)", LAYER)],
        "TABLES": [("tables()", TABLES)],
        "PREDICTORS": [("predictors_block()", PREDICTORS), ("layer(rows, columns)", LAYER_OF_PREDICTOR)],
        "ENTROPY_NETWORK": [
            ("entropy_network_block()", ENTROPY_NETWORK),
            ("linear(rows, columns)", LINEAR),
            ("matrix(rows, columns)", MATRIX),
        ],
        "HASH_GRID": [("hash_grid_block()", HASH_GRID)],
        "STREAMING": [("streaming_block()", STREAMING)],
    }
    return {name: partial(_listings, rows) for name, rows in declared.items()}


def _listings(declared: list[tuple[str, Record]]) -> str:
    return "```\n" + "\n".join(listing(title, record) for title, record in declared) + "```\n"


def _parts() -> dict[str, Callable[[], str]]:
    """Every generated part but the contents of a page."""
    structures = {name: (lambda name=name: markdown_table(name)) for name in STRUCTURES}
    return {
        **structures,
        "channels": channel_table,
        "block-kinds": _block_kinds,
        **layouts(),
        "work": _work_values,
        "worked-tour": lambda: tour_text(worked_file()),
        "worked-rans": lambda: rans_text(worked_file()),
        "worked-values": value_text,
        "TANH": lambda: _numbers(tables.TANH),
        "SIGMOID": lambda: _numbers(tables.SIGMOID),
        "EXP2": lambda: _numbers(tables.EXP2),
        "worked-network": lambda: table_text(network_rows()),
        "worked-evaluation": lambda: table_text(evaluation_rows()),
    }


def generate() -> dict[Path, str]:
    """The text of each of `PAGES` with every generated part made anew.

    Raises:
        ValueError: a part is missing, stands twice, or is none that can be made.
    """
    parts, texts = _parts(), {page: page.read_text() for page in PAGES}
    found = [match[1] for text in texts.values() for match in _PART.finditer(text) if match[1] != "contents"]
    if sorted(found) != sorted(parts):
        raise ValueError(f"the generated parts are {sorted(found)}, expected are {sorted(parts)}")

    def renewed(text: str) -> str:
        def part(match: re.Match[str]) -> str:
            made = contents(text) if match[1] == "contents" else parts[match[1]]()
            return f"<!-- table:{match[1]} -->\n{made}<!-- end -->\n"

        return _PART.sub(part, text)

    return {page: renewed(text) for page, text in texts.items()}


def main(arguments: list[str]) -> int:
    """Check the pages, or write them; returns the exit status."""
    made = generate()
    stale = [page for page, text in made.items() if page.read_text() != text]
    for page in stale:
        if arguments == ["--write"]:
            page.write_text(made[page])
            print(f"{page.name} written")
        else:
            print(f"{page.name} is stale: run python -m conformance.spec.spec_tables --write")
    if not stale:
        print("the texts are up to date")
    return 0 if arguments == ["--write"] else int(bool(stale))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
