"""METADATA (SPEC §7.10), with a JSON parser that refuses what SPEC forbids."""

from __future__ import annotations

import json
from typing import Any

from conformance.decoders.python.container import METADATA_KIND, annotation
from conformance.decoders.python.fields import Refused, require

MAX_DEPTH = 64
MAX_BYTES = 1 << 20


def read_metadata(data: bytes) -> Any:
    """The object of a file whose header and directory are sound; None where it has none."""
    block = annotation(data, METADATA_KIND, MAX_BYTES)
    return None if block is None else parse_metadata(block)


def parse_metadata(block: bytes) -> Any:
    """The object in the bytes of a block."""
    require(nesting(block) <= MAX_DEPTH, "limit-metadata")
    try:
        value = json.loads(
            block.decode("utf-8"),
            parse_constant=_no_constant,
            parse_float=_number,
            parse_int=lambda text: int(text) if _number(text) else 0,
            object_pairs_hook=_members,
        )
        _whole_characters(value)
    except ValueError as error:
        raise Refused("bad-metadata") from error
    require(isinstance(value, dict), "bad-metadata")
    return value


def nesting(block: bytes) -> int:
    """The function of that name of §7.10."""
    depth = deepest = at = 0
    quoted = False
    while at < len(block):
        byte = block[at : at + 1]
        if quoted:
            at += byte == b"\\"
            quoted = byte != b'"'
        elif byte == b'"':
            quoted = True
        elif byte in (b"[", b"{"):
            depth += 1
            deepest = max(deepest, depth)
        elif byte in (b"]", b"}"):
            depth -= 1
        at += 1
    return deepest


def _no_constant(name: str) -> None:
    raise ValueError(name)


def _number(text: str) -> float:
    value = float(text)
    if abs(value) == float("inf"):
        raise ValueError(text[:20])
    return value


def _members(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object: the last of equal names counts, but all are looked at."""
    for name, value in pairs:
        _whole_characters([name, value])
    return dict(pairs)


def _whole_characters(value: Any) -> None:
    """Half a surrogate pair has no UTF-8; objects within have been looked at by themselves."""
    if isinstance(value, str):
        value.encode("utf-8")
    if isinstance(value, list):
        for part in value:
            _whole_characters(part)
