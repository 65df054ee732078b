"""The independence that README.md of the suite claims: of what reads the vectors, not of what writes them."""

from __future__ import annotations

import ast
import sys

from conformance.generate import ROOT


def test_the_readable_decoder_has_the_standard_library_alone() -> None:
    found = set()
    for path in (ROOT / "decoders" / "python").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found.add(node.module or "")
    others = {module for module in found if not module.startswith("conformance.decoders.python")}
    assert {module for module in others if module.split(".")[0] not in sys.stdlib_module_names} == set()
