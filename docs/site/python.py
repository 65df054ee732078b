"""The page of the Python interface: docstrings of the names that `import scarfmt` gives."""

from __future__ import annotations

import inspect

import scarfmt

_OF_CLASSES = ("members", "inherited-members: Exception,RuntimeError,ValueError,Warning,UserWarning")


def page() -> str:
    """Markdown: functions first, then classes, each in alphabetic order."""
    names = [name for name in scarfmt.__all__ if not name.startswith("__")]
    functions = [name for name in names if not inspect.isclass(getattr(scarfmt, name))]
    classes = [name for name in names if name not in functions]
    return "\n".join(
        ["## Functions", *map(_function, functions), "## Classes", *map(_class, classes)],
    )


def _function(name: str) -> str:
    return f"\n### {name}\n\n```{{eval-rst}}\n.. autofunction:: scarfmt.{name}\n```\n"


def _class(name: str) -> str:
    options = "".join(f"\n   :{option}" + ("" if ":" in option else ":") for option in _OF_CLASSES)
    return f"\n### {name}\n\n```{{eval-rst}}\n.. autoclass:: scarfmt.{name}{options}\n```\n"
