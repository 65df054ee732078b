"""The independence that README.md of the suite claims: which module imports what of the tested package."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
CONFORMANCE = REPOSITORY / "conformance"
PACKAGE = ("scarfmt", "reference_decoder", "reference_encoder")

VALUES = {
    "scarfmt.arrays": {"F32", "F64", "I16", "I32", "I64", "Floats", "Ints", "U8", "U64"},
    "scarfmt.blocks.mlp": {"Linear", "QuantisedMlp"},
    "scarfmt.blocks.streaming": {"Streaming"},
    "scarfmt.coding.writer": {"QuantisedScene"},
    "scarfmt.container.file": {"Block", "HeaderFields", "Tile"},
    "scarfmt.container.schema": {"BlockKind", "Profile", "Stream"},
    "scarfmt.neural.arithmetic": {"Linear"},
    "scarfmt.neural.grid": {"HashGrid"},
    "scarfmt.neural.network": {"Attention", "GruLayer", "Head", "IndexNetwork"},
    "scarfmt.neural.predictors": {"Predictor"},
    "scarfmt.scene.model": {"Channel", "ContextRule", "DecodedContext", "LayerRow", "SceneModel"},
}
"""The classes and enumerations that hold a scene in memory: all that the suite's writer has of the package."""

DECODER = CONFORMANCE / "decoders" / "python"
PACKS = re.compile(r"(un)?pack_|(re)?write_|coded?_|put_|.*(Encoder|Decoder|Reader|SceneWriter|SymbolWriter)$")

Import = tuple[str, str]
"""Module and name imported from it; an empty name for a whole module."""


def modules(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.py") if "suite" not in path.relative_to(CONFORMANCE).parts)


def imports(path: Path) -> Iterator[Import]:
    """Every import of a module, also of those inside functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)


def of_package(path: Path) -> set[Import]:
    return {found for found in imports(path) if found[0].split(".")[0] in PACKAGE}


@pytest.mark.parametrize("path", modules(CONFORMANCE / "writer"), ids=lambda path: path.stem)
def test_the_writer_has_nothing_of_the_package_but_values(path: Path) -> None:
    """The writer packs, codes and evaluates with code of its own."""
    assert not {(module, name) for module, name in of_package(path) if name not in VALUES.get(module, set())}


@pytest.mark.parametrize("path", modules(DECODER), ids=lambda path: path.stem)
def test_the_second_decoder_has_the_standard_library_alone(path: Path) -> None:
    """The only exception is the package zstandard, for frames with Huffman or FSE codes."""
    allowed = sys.stdlib_module_names | {"zstandard"}
    strange = {module for module, _ in imports(path) if module.split(".")[0] not in allowed}
    assert not {module for module in strange if not module.startswith("conformance.decoders.python")}


@pytest.mark.parametrize("folder", ["faults", "scenes", "expect"])
def test_vectors_are_not_packed_by_the_package(folder: str) -> None:
    """Parsers may take valid files apart, to bend them: what they say is put together by the suite's writer."""
    found = {name for path in modules(CONFORMANCE / folder) for _, name in of_package(path)}
    packing = {name for name in found if PACKS.match(name) and not name.startswith("unpack_")}
    assert not packing - {"ByteReader"}
    assert not [path for path in modules(CONFORMANCE / folder) if "reference_encoder" in path.read_text()]
