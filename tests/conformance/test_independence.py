"""The writer of the vectors and the Python decoder are checks of the reference only as long as they share no code."""

from __future__ import annotations

import ast
from collections import defaultdict

from tests.conftest import REPOSITORY

VALUES = {
    "scarfmt.blocks.mlp": {"Linear", "QuantisedMlp"},
    "scarfmt.coding.writer": {"QuantisedScene"},
    "scarfmt.container.file": {"Block", "HeaderFields", "Tile"},
    "scarfmt.container.schema": {"BlockKind", "Profile", "Stream"},
    "scarfmt.neural.arithmetic": {"Linear"},
    "scarfmt.neural.grid": {"HashGrid"},
    "scarfmt.neural.network": {"Attention", "GruLayer", "Head", "IndexNetwork"},
    "scarfmt.neural.predictors": {"Predictor"},
    "scarfmt.scene.model": {"Channel", "ContextRule", "LayerRow", "SceneModel"},
}
"""Classes that hold numbers and names of numbers: what a scene is before it is written. None packs or computes."""


def _imported() -> dict[str, set[str]]:
    """Names imported from the reference, by module."""
    found: dict[str, set[str]] = defaultdict(set)
    for folder in ("writer", "decoders/python"):
        for path in sorted((REPOSITORY / "conformance" / folder).glob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("scarfmt", "reference_")):
                    found[node.module or ""] |= {name.name for name in node.names}
                elif isinstance(node, ast.Import):
                    assert not [name for name in node.names if name.name.startswith(("scarfmt", "reference_"))], path
    return found


def test_only_values_of_the_reference_are_used() -> None:
    found = _imported()
    assert found, "nothing was looked at"
    for module, names in found.items():
        assert names <= VALUES.get(module, set()), module


def test_no_permission_is_left_over() -> None:
    assert _imported().keys() == VALUES.keys()
