"""The generated parts of SPEC.md, and of the page of refusals of the tools.

``python -m conformance.spec.spec_tables [--write]``

A part stands between the lines ``<!-- table:NAME -->`` and ``<!-- end -->``. Without ``--write`` the script only says
which parts are stale, and fails if any are; tests/conformance/spec/test_spec.py does the same.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from conformance.decoders.python.decoder import Decoder
from conformance.expect.work import Work
from conformance.spec.contents import contents
from conformance.spec.examples import example_parts
from conformance.spec.worked import field_table_text, hex_dump, rans_text, value_text, worked_file
from conformance.spec.worked_network import evaluation_rows, network_rows, table_text
from conformance.spec.worked_tour import tour_text
from scarfmt.blocks.codebooks import CODEBOOKS
from scarfmt.blocks.declare import Record
from scarfmt.blocks.hash_grid import HASH_GRID
from scarfmt.blocks.index_network import ENTROPY_NETWORK, LINEAR, MATRIX
from scarfmt.blocks.layer import LAYER
from scarfmt.blocks.listing import listing
from scarfmt.blocks.mlp import NETWORKS
from scarfmt.blocks.predictors import LAYER_OF_PREDICTOR, PREDICTORS
from scarfmt.blocks.registry import element_table
from scarfmt.blocks.streaming import STREAMING
from scarfmt.blocks.tables import TABLES
from scarfmt.container.schema import STRUCTURES, markdown_table
from scarfmt.neural import tables
from scarfmt.scene.streams import channel_table

ROOT = Path(__file__).resolve().parents[2]
SPEC = ROOT / "SPEC.md"
TOOLS = ROOT / "docs" / "tool-refusals.md"
PAGES = (SPEC, TOOLS)
CODE = ("scarfmt", "reference_decoder", "reference_encoder")
ERRORS = {"Malformed", "Truncated", "Unsupported", "LimitExceeded", "InvalidInput"}
# Prefixes, and two ids of calls and sources that promised too much: no bytes of a file can cause them.
_TOOL_IDS = ("input-", "output-", "work-", "inexact-", "block-range", "truncated-source")
_WORK_OF = ("worked", "valid/explicit-refined", "valid/predictors", "valid/index-two-level", "valid/anchors-neural")
_PART = re.compile(r"<!-- table:([\w-]+) -->\n(.*?)<!-- end -->\n", re.DOTALL)
_REFUSAL = re.compile(r"[a-z]+(-[a-z]+)+")


def raised_ids() -> dict[str, set[str]]:
    """Every refusal id in the code -> the modules that raise it.

    Found are: a first argument of an error class; a second argument of a ``check`` (rules over whole tables); and a
    second item of a tuple in the table of header rules and limits.
    """
    out: dict[str, set[str]] = defaultdict(set)
    for package in CODE:
        for path in sorted((ROOT / package).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            for refusal in _ids_in(ast.parse(path.read_text()), module):
                out[refusal].add(module)
    return out


def _ids_in(tree: ast.AST, module: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
            arguments = node.args[:1] if name in ERRORS else node.args[1:2] if name == "check" else []
        elif isinstance(node, ast.Tuple) and module == "scarfmt.container.header":
            arguments = node.elts[1:2]
        else:
            continue
        for argument in arguments:
            value = argument.value if isinstance(argument, ast.Constant) else None
            if isinstance(value, str) and _REFUSAL.fullmatch(value):
                yield value


def is_tool_id(refusal: str) -> bool:
    """Whether an id belongs to the tools, not to the format."""
    return refusal.startswith(_TOOL_IDS)


def _tool_ids() -> str:
    ids = {refusal: modules for refusal, modules in raised_ids().items() if is_tool_id(refusal)}
    lines = ["| id | raised in |", "|---|---|"]
    lines += [f"| `{refusal}` | {', '.join(sorted(ids[refusal]))} |" for refusal in sorted(ids)]
    return "\n".join(lines) + "\n"


def _work_values() -> str:
    """work(k) of §13.2 at the last layer of some vectors, in its four parts."""
    lines = ["| vector | k | models | splits | tiles | anchors | an anchor | work(k) |", f"|---|{'---:|' * 7}"]
    for id_ in _WORK_OF:
        work = Work(Decoder((ROOT / "conformance" / "vectors" / id_ / "input.scar").read_bytes()))
        parts = work.parts()
        numbers = (work.k, parts.models, parts.splits, parts.tiles, parts.anchors, parts.an_anchor, parts.total)
        lines.append(f"| `{id_}` | {' | '.join(map(str, numbers))} |")
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


def _parts(text: str) -> dict[str, Callable[[], str]]:
    structures = {name: (lambda name=name: markdown_table(name)) for name in STRUCTURES}
    return {
        **structures,
        "contents": lambda: contents(text),
        "channels": channel_table,
        "element-counts": element_table,
        **layouts(),
        "work": _work_values,
        "worked-tour": lambda: tour_text(worked_file()),
        "worked-hex": lambda: hex_dump(worked_file()),
        "worked-fields": lambda: field_table_text(worked_file()),
        "worked-rans": lambda: rans_text(worked_file()),
        "worked-values": value_text,
        "TANH": lambda: _numbers(tables.TANH),
        "SIGMOID": lambda: _numbers(tables.SIGMOID),
        **example_parts(),
        "EXP2": lambda: _numbers(tables.EXP2),
        "worked-network": lambda: table_text(network_rows()),
        "worked-evaluation": lambda: table_text(evaluation_rows()),
    }


def generated(page: Path) -> str:
    """The text of one of `PAGES` with every generated part made anew.

    Raises:
        ValueError: a part is missing, or is none that can be made.
    """
    text = page.read_text()
    parts = _parts(text) if page == SPEC else {"tool-ids": _tool_ids}
    found = {match[1] for match in _PART.finditer(text)}
    if found != set(parts):
        raise ValueError(f"{page.name} has the generated parts {sorted(found)}, expected are {sorted(parts)}")
    return _PART.sub(lambda match: f"<!-- table:{match[1]} -->\n{parts[match[1]]()}<!-- end -->\n", text)


def main(arguments: list[str]) -> int:
    """Check the pages, or write them; returns the exit status."""
    made = {page: generated(page) for page in PAGES}
    stale = [page for page, text in made.items() if page.read_text() != text]
    for page in stale:
        if arguments == ["--write"]:
            page.write_text(made[page])
            print(f"{page.name} written")
        else:
            print(f"{page.name} is stale: run python -m conformance.spec.spec_tables --write")
    if not stale:
        print("SPEC.md and the page of tools are up to date")
    return 0 if arguments == ["--write"] else int(bool(stale))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
