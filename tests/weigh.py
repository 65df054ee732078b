"""`make weigh`: how much there is to hold in a head. Lines, files, classes, import circles, words, test cases.

``python -m tests.weigh`` prints a table; ``--walk`` adds how many files and functions a default encode and decode of
the example scene enter.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
PRODUCT = ("scarfmt/", "reference_encoder/", "reference_decoder/")
EXAMPLE = REPOSITORY / "examples" / "plush-toys.ply"


def tracked() -> list[str]:
    """Names of all files under version control."""
    return subprocess.check_output(["git", "ls-files"], cwd=REPOSITORY, text=True).splitlines()


def lines(names: Iterable[str]) -> int:
    """Lines of text files, all together."""
    return sum(len((REPOSITORY / name).read_bytes().splitlines()) for name in names)


def words(names: Iterable[str]) -> int:
    """Words between white space."""
    return sum(len((REPOSITORY / name).read_text().split()) for name in names)


def classes(names: Iterable[str]) -> int:
    """Class definitions of Python files."""
    trees = (ast.parse((REPOSITORY / name).read_text()) for name in names)
    return sum(isinstance(node, ast.ClassDef) for tree in trees for node in ast.walk(tree))


def imports(name: str, modules: set[str]) -> Iterator[str]:
    """Modules of this repository that a file imports, wherever in the file."""
    for node in ast.walk(ast.parse((REPOSITORY / name).read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in modules else node.module


def circles(names: Iterable[str]) -> list[list[str]]:
    """Groups of modules that import each other, directly or through others."""
    files = {name.removesuffix(".py").removesuffix("/__init__").replace("/", "."): name for name in names}
    edges = {module: {found for found in imports(name, set(files)) if found in files} for module, name in files.items()}
    reach: dict[str, set[str]] = {}
    for module in files:
        found, todo = set(), list(edges[module])
        while todo:
            if (other := todo.pop()) not in found:
                found.add(other)
                todo += edges[other]
        reach[module] = found
    groups = {frozenset({m, *(o for o in reach[m] if m in reach[o])}) for m in files if m in reach[m]}
    return sorted(sorted(group) for group in groups)


def walk(*arguments: str) -> tuple[int, int]:
    """Files and functions of the product that a command enters, imports left out."""
    counter = Path(__file__).with_name("walk.py")
    command = [sys.executable, str(counter), *arguments]
    found = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True)
    entered = json.loads(found.stdout.splitlines()[-1])
    return len({file for file, _ in entered}), len(entered)


def table() -> dict[str, object]:
    """Figures by name."""
    names = [name for name in tracked() if (REPOSITORY / name).is_file() and not (REPOSITORY / name).is_symlink()]
    python = [name for name in names if name.endswith(".py")]
    product = [name for name in python if name.startswith(PRODUCT)]
    pages = [n for n in names if n.endswith(".md") and not n.startswith(("docs/decisions/", "SPEC"))]
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider"]
    collected = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True).stdout
    cases = re.search(r"(\d+)(?:/\d+)? tests collected", collected)
    return {
        "Python lines, tests apart": lines(name for name in python if not name.startswith("tests/")),
        "Python lines of tests": lines(name for name in python if name.startswith("tests/")),
        "C lines": lines(name for name in names if name.endswith((".c", ".h"))),
        "JavaScript and TypeScript lines": lines(name for name in names if name.endswith((".js", ".mjs", ".ts"))),
        "tracked files": len(names),
        "tracked files of vectors": sum(name.startswith("conformance/vectors") for name in names),
        "classes of the product": classes(product),
        "import circles": len(circles(product)),
        "bytes of SPEC.md": (REPOSITORY / "SPEC.md").stat().st_size,
        "bytes of SPEC-neural.md": sum((REPOSITORY / n).stat().st_size for n in names if n == "SPEC-neural.md"),
        "words of docs, SPEC and decisions apart": words(pages),
        "test cases": int(cases[1]) if cases else collected[-200:],
    }


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--walk", action="store_true", help="also trace a default encode and decode")
    parser.add_argument("--circles", action="store_true", help="name the modules of each import circle")
    options = parser.parse_args()
    for name, figure in table().items():
        print(f"{name:42} {figure:>10,}" if isinstance(figure, int) else f"{name:42} {figure}")
    if options.circles:
        for group in circles(n for n in tracked() if n.endswith(".py") and n.startswith(PRODUCT)):
            print("circle:", " ".join(group))
    if options.walk:
        with tempfile.TemporaryDirectory() as folder:
            file = f"{folder}/toys.scar"
            print("{:42} {} files, {} functions".format("default encode", *walk("encode", str(EXAMPLE), file)))
            print("{:42} {} files, {} functions".format("default decode", *walk("decode", file, f"{folder}/toys.ply")))
    return 0


if __name__ == "__main__":
    sys.exit(main())
