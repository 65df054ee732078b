"""JSON as the vectors have it: what fits a line or lies deep is on one line, the rest indented by one."""

from __future__ import annotations

import json
from typing import Any

_WIDTH = 110


def json_text(value: Any, levels: int = 100) -> str:
    """The text of a JSON value, keys in their order, with a line end; values below `levels` others take one line."""
    return _text(value, 0, levels) + "\n"


def _text(value: Any, depth: int, levels: int) -> str:
    line = json.dumps(value, allow_nan=False, ensure_ascii=False)
    if not isinstance(value, dict | list) or depth == levels or len(line) + depth <= _WIDTH:
        return line
    pad = " " * (depth + 1)
    if isinstance(value, dict):
        items = ((json.dumps(key, ensure_ascii=False), _text(item, depth + 1, levels)) for key, item in value.items())
        parts = [f"{key}: {text}" for key, text in items]
    else:
        parts = [_text(item, depth + 1, levels) for item in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n{pad}" + f",\n{pad}".join(parts) + f"\n{' ' * depth}{closing}"
