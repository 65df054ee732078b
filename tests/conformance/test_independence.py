"""The independence that README.md of the suite claims: what its writer and decoder import of the tested package."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from conformance.generate import ROOT

PACKAGE = ("scarfmt", "reference_decoder", "reference_encoder")
PACKS = re.compile(r"(un)?pack_|(re)?write_|coded?_|put_|.*(Encoder|Decoder|Reader|SceneWriter|SymbolWriter)$")


def imports(folder: str) -> Iterator[tuple[Path, str, str]]:
    """Every import of a folder's modules, also inside functions: the file, the module, the name; "" for a module."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from ((path, alias.name, "") for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield from ((path, node.module or "", alias.name) for alias in node.names)


def test_the_writer_has_nothing_of_the_package_but_classes_of_values() -> None:
    """The writer packs, codes and evaluates with code of its own: it imports no function, and no class that packs."""
    found = {(path.name, name) for path, module, name in imports("writer") if module.split(".")[0] in PACKAGE}
    assert found
    assert {(path, name) for path, name in found if not name[:1].isupper() or PACKS.match(name)} == set()


def test_the_readable_decoder_has_the_standard_library_alone() -> None:
    modules = {module for _, module, _ in imports("decoders/python")}
    own = {module for module in modules if module.startswith("conformance.decoders.python")}
    assert {module for module in modules - own if module.split(".")[0] not in sys.stdlib_module_names} == set()


def test_vectors_are_not_packed_by_the_package() -> None:
    """Parsers may take valid files apart, to bend them: what they say is put together by the suite's writer."""
    found = [row for folder in ("faults", "scenes", "expect") for row in imports(folder) if row[1].startswith(PACKAGE)]
    packing = {name for _, _, name in found if PACKS.match(name) and not name.startswith("unpack_")}
    assert packing <= {"ByteReader"}
    assert not [path for path, module, _ in found if module.startswith("reference_encoder")]
