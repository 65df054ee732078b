"""Engines by name, and that every caller of the product passes the best one on."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from reference_decoder.backends import BACKENDS, backend, described
from scarfmt.coding.engine import NumpyEngine
from scarfmt.engines import NAMES, absence, best_engine, engine_named
from scarfmt.errors import InvalidInput
from scarfmt.kernel.engine import KernelEngine
from scarfmt.neural.operations import NumpyOperations

REPOSITORY = Path(__file__).parents[1]
PRODUCT = ("reference_decoder", "reference_encoder", "scarfmt/cli", "scarfmt/tools", "scarfmt/api.py",
           "conformance/suite/scarfmt_conformance")  # fmt: skip
# How many arguments come before `engine`; without it they compute by the definition.
TAKES_ENGINE = {"SceneReader": 99, "write_scene": 2, "put_layer": 6, "get_layer": 11, "fine": 2}
# What has an engine's form, and must not be called but by it.
DEFINITIONS = {"CellSums", "channel_values", "get_channel", "put_channel", "get_positions"}


def calls() -> Iterator[tuple[Path, ast.Call, str]]:
    """Every call of a plain name in the product's callers."""
    for place in PRODUCT:
        for path in sorted((REPOSITORY / place).rglob("*.py")) or [REPOSITORY / place]:
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                    yield path, node, node.func.id


def reads_models_only(path: Path) -> bool:
    """Whether a module decodes no tile: parsing models takes no engine."""
    return path.name != "answers.py" and ".tiles(" not in path.read_text()


def test_every_caller_passes_an_engine() -> None:
    """A caller that forgets it would be several times slower and still right, so no other test would fail."""
    seen = set()
    for path, call, name in calls():
        where = f"{path}:{call.lineno}"
        assert name not in DEFINITIONS, where
        if name in TAKES_ENGINE and not (name == "SceneReader" and reads_models_only(path)):
            seen.add(name)
            named = any(keyword.arg == "engine" for keyword in call.keywords)
            assert named or len(call.args) > TAKES_ENGINE[name], f"{where}: {name} without an engine"
    assert {"SceneReader", "write_scene", "put_layer", "fine"} <= seen


def test_names() -> None:
    """The best is the kernel where there is one; NumPy is never the kernel."""
    assert set(NAMES) < set(BACKENDS)
    assert type(engine_named("numpy")) is NumpyEngine
    assert engine_named("numpy").name == "numpy"
    best = engine_named("auto")
    assert isinstance(best, KernelEngine) == (absence() is None)
    assert best.name == best_engine().name == backend("auto").name
    assert described("auto").startswith(best.name)
    assert described("numpy") == "numpy"
    operations = NumpyOperations()
    assert engine_named("auto", operations).operations is operations
    torch = backend("torch")
    assert type(torch) is type(best)
    assert type(torch.operations).__name__ == "TorchOperations"
    assert described("torch") == f"{best.name}, index network by torch on the CPU"


@pytest.mark.parametrize("make", [engine_named, backend])
def test_an_unknown_name_is_refused(make: type) -> None:
    """With those that are known."""
    with pytest.raises(InvalidInput, match="auto, kernel, numpy") as caught:
        make("abacus")
    assert caught.value.refusal == "input-backend"


def in_process(code: str, **environment: str) -> str:
    """The output of a process of its own."""
    kept = {name: value for name, value in os.environ.items() if name != "SCARFMT_KERNEL"}
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, env={**kept, **environment}, capture_output=True, text=True, check=True
    ).stdout.strip()


def test_the_variable_is_read_once() -> None:
    """Later changes of the environment change no engine; asking for the kernel where it is off is refused."""
    code = """
import os
from scarfmt.engines import best_engine, engine_named
print(best_engine().name)
os.environ["SCARFMT_KERNEL"] = "1"
print(best_engine().name)
try:
    engine_named("kernel")
except Exception as error:
    print(error)
"""
    first, later, refusal = in_process(code, SCARFMT_KERNEL="0").splitlines()
    assert (first, later) == ("numpy", "numpy")
    assert "turned off by SCARFMT_KERNEL=0" in refusal


def test_saying_which_engine_computes_imports_none() -> None:
    """`scarfmt --version` and `inspect` start as fast as before."""
    code = "import sys; from scarfmt.engines import described; described(); print('constriction' in sys.modules)"
    assert in_process(code) == "False"
