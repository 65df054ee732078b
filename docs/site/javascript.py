"""The page of the JavaScript interface: declarations and comments as the TypeScript compiler writes them.

`make docs` lets it write them to `TYPES`, from the sources of `web/src`.
"""

from __future__ import annotations

import re
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
TYPES = REPOSITORY / "build" / "docs" / "types" / "web" / "src"
ENTRIES = {
    "scar-stream": "index.d.ts",
    "scar-stream/spark": "adapters/spark.d.ts",
    "scar-stream/playcanvas": "adapters/playcanvas.d.ts",
}
"""The modules that a page imports from, and the files that declare them."""

_DECLARATION = re.compile(
    r"^(?P<comment>/\*\*(?:(?!\*/).)*\*/\n)?"
    r"(?P<code>export (?:declare )?(?:async )?(?:abstract )?(?:class|interface|type|function|const) (?P<name>\w+)"
    r".*?(?:;|\}))$(?=\n[^\s}]|\n?\Z)",
    re.MULTILINE | re.DOTALL,
)
_EVERYTHING = re.compile(r'^export (?:type )?\* from "(.+?)";$', re.MULTILINE)
_SOME = re.compile(r'^export (?:type )?\{(.+?)\} from "(.+?)";$', re.MULTILINE)


def declarations(text: str) -> dict[str, tuple[str, str]]:
    """(comment as prose, declaration) of what a file declares and exports, by name."""
    found = {}
    for match in _DECLARATION.finditer(text):
        code = re.sub(r"^ +(?:#private|private .*);\n", "", match["code"], flags=re.MULTILINE)
        found[match["name"]] = (_prose(match["comment"] or ""), code.removeprefix("export ").removeprefix("declare "))
    return found


def exported(path: Path) -> dict[str, tuple[str, str]]:
    """(comment, declaration) of all that the module at `path` exports, its own first.

    Raises:
        KeyError: a name is exported whose declaration is not found.
    """
    text = path.read_text(encoding="utf-8")
    found = declarations(text)
    for name in _EVERYTHING.findall(text):
        found |= exported(_module(path, name))
    for names, module in _SOME.findall(text):
        there = exported(_module(path, module))
        found |= {name: there[name] for name in (one.split()[-1] for one in names.split(","))}
    return found


def page() -> str:
    """Markdown: a section for each module, and in it one for each name."""
    return "\n".join(f"## {module}\n\n{_listed(exported(TYPES / path))}" for module, path in ENTRIES.items())


def _listed(names: dict[str, tuple[str, str]]) -> str:
    return "\n".join(
        f"### {name}\n\n{prose}\n\n```typescript\n{code}\n```\n" for name, (prose, code) in sorted(names.items())
    )


def _prose(comment: str) -> str:
    """A doc comment without its frame."""
    lines = [line.strip().removeprefix("/**").removesuffix("*/").strip() for line in comment.splitlines()]
    return "\n".join(line.removeprefix("*").strip() for line in lines).strip()


def _module(path: Path, name: str) -> Path:
    return path.parent / name.replace(".js", ".d.ts")
