"""Rules that every file of the repository keeps, so that any of them can be read in one sitting."""

from __future__ import annotations

import ast
import subprocess

from tests.conftest import REPOSITORY

MOST_LINES_OF_A_FUNCTION = 60
MOST_LINES_OF_A_FILE = 600
LANGUAGES = (".py", ".c", ".h", ".js", ".mjs", ".ts", ".sh")
UNTRACKED = {".venv", "node_modules", "dist"}
_MARKS = {True: ("#",), False: ("//", "/*", "*")}
SHIPPED = ("scarfmt", "reference_decoder", "reference_encoder", "conformance", "fuzz", "benchmarks", "release")


def sources(endings: tuple[str, ...]) -> list[str]:
    """Names of the files of the repository with one of these endings."""
    try:
        done = subprocess.run(["git", "ls-files"], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        inside = [path.relative_to(REPOSITORY) for path in REPOSITORY.rglob("*")]
        found = [str(path) for path in inside if UNTRACKED.isdisjoint(path.parts)]
    else:
        found = done.stdout.splitlines()
    chosen = [name for name in found if name.endswith(endings)]
    return [name for name in chosen if (REPOSITORY / name).is_file()]


SOURCES = sources(LANGUAGES)
PYTHON = [name for name in SOURCES if name.endswith(".py")]


def _text(name: str) -> str:
    return (REPOSITORY / name).read_text(encoding="utf-8")


def lines_of_code(text: str, python: bool) -> int:
    """Lines that are neither empty nor comment nor, in Python, docstring."""
    lines = [line.strip() for line in text.splitlines()]
    kept = {number for number, line in enumerate(lines, 1) if line and not line.startswith(_MARKS[python])}
    for node in ast.walk(ast.parse(text)) if python else ():
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                kept -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(kept)


def functions(text: str) -> list[tuple[str, int]]:
    """(name, lines) of every function, decorators and docstring included."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [
        (node.name, (node.end_lineno or node.lineno) - node.lineno + 1)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, kinds)
    ]


def test_no_file_is_long() -> None:
    assert len(PYTHON) > 100
    counted = [(name, lines_of_code(_text(name), name.endswith(".py"))) for name in SOURCES]
    assert not [one for one in counted if one[1] > MOST_LINES_OF_A_FILE]


def test_no_function_is_long() -> None:
    long = [(name, *one) for name in PYTHON for one in functions(_text(name)) if one[1] > MOST_LINES_OF_A_FUNCTION]
    assert not long


def test_every_package_says_what_is_in_it() -> None:
    packages = [name for name in PYTHON if name.endswith("__init__.py") and name.startswith(SHIPPED)]
    assert packages
    assert not [name for name in packages if not (ast.get_docstring(ast.parse(_text(name))) or "").strip()]
