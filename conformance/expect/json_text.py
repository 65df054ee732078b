"""JSON as the vectors have it: what fits a line is on one line, the rest indented by one."""

from __future__ import annotations

import json
from typing import Any

_WIDTH = 110


def json_text(value: Any) -> str:
    """The text of a JSON value, keys in their order, with a line end."""
    return _text(value, 0) + "\n"


def _text(value: Any, depth: int) -> str:
    line = json.dumps(value, allow_nan=False, ensure_ascii=False)
    if not isinstance(value, dict | list) or len(line) + depth <= _WIDTH:
        return line
    pad = " " * (depth + 1)
    if isinstance(value, dict):
        parts = [f"{json.dumps(key, ensure_ascii=False)}: {_text(item, depth + 1)}" for key, item in value.items()]
    else:
        parts = [_text(item, depth + 1) for item in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n{pad}" + f",\n{pad}".join(parts) + f"\n{' ' * depth}{closing}"
