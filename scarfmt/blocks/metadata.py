"""METADATA blocks: one JSON object about the scene (SPEC §7.10)."""

from __future__ import annotations

import json
import math
import re
import warnings
from collections.abc import Mapping
from itertools import accumulate
from typing import Any

from scarfmt.container.paged import Container
from scarfmt.container.registries import BlockKind
from scarfmt.errors import InputWarning, InvalidInput, LimitExceeded, Malformed
from scarfmt.limits import MAX_METADATA_DEPTH
from scarfmt.scene.description import Description

_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?+', re.DOTALL)
_STEP = {**dict.fromkeys(b"[{", 1), **dict.fromkeys(b"]}", -1)}
_NO_BRACKETS = bytes(set(range(256)) - _STEP.keys())
# Of JSON that was parsed: a pair of surrogates, one that is alone (the group), or any other escape.
_ESCAPE = re.compile(r"\\u[dD][89abAB]..\\u[dD][c-fC-F]..|(\\u[dD][89a-fA-F]..)|\\.")


def pack_metadata(metadata: Mapping[str, Any]) -> bytes:
    """A METADATA block: keys sorted by code point, no white space (R-7.10-2).

    Args:
        metadata: strings, numbers, booleans, None, lists and dicts of them.

    Raises:
        InvalidInput: ``input-options``: JSON cannot hold it, or a reader would refuse it.
    """
    try:
        data = json.dumps(metadata, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
        parse_metadata(data)
    except (TypeError, ValueError, RecursionError, Malformed, LimitExceeded) as error:
        reason = error.message if isinstance(error, Malformed | LimitExceeded) else str(error)
        raise InvalidInput("input-options", f"metadata: {reason}", field="metadata") from error
    return data


def parse_metadata(data: bytes, offset: int | None = None) -> dict[str, Any]:
    """The object of a METADATA block.

    Nesting is checked first: how deep a JSON parser gets depends on the interpreter.

    Args:
        offset: of the block in the file, bytes, for messages.

    Raises:
        LimitExceeded: ``limit-metadata``: nested deeper than `MAX_METADATA_DEPTH` (R-7.10-3).
        Malformed: ``bad-metadata``: no JSON object in UTF-8, a number beyond binary64, or half a surrogate pair,
            also in a member that is not reported because its name comes again (R-7.10-1).
    """
    deepest = nesting(data)
    if deepest > MAX_METADATA_DEPTH:
        message = f"nested {deepest} deep; {MAX_METADATA_DEPTH} is the most"
        raise LimitExceeded("limit-metadata", message, offset=offset, field="METADATA")
    try:
        text = data.decode("utf-8")
        value = json.loads(text, parse_constant=_refuse_constant, parse_float=_finite, parse_int=_whole)
        alone = next((found[1] for found in _ESCAPE.finditer(text) if found[1]), None)
        if alone is not None:
            raise ValueError(f"{alone} is half a surrogate pair")
    except ValueError as error:
        raise Malformed("bad-metadata", f"not JSON: {error}", offset=offset, field="METADATA") from error
    if not isinstance(value, dict):
        message = f"a JSON {type(value).__name__}, not an object"
        raise Malformed("bad-metadata", message, offset=offset, field="METADATA")
    return value


def check_registered(metadata: Mapping[str, Any], offset: int | None = None) -> None:
    """Check the members whose meaning SPEC states (R-7.10-4).

    Raises:
        Malformed: ``bad-metadata``.
    """
    if "coordinate_reference" not in metadata:
        return
    found = metadata["coordinate_reference"]
    origin = found.get("origin") if isinstance(found, dict) else None
    numbers = isinstance(origin, list) and len(origin) == 3 and all(type(x) in (int, float) for x in origin)
    if not (numbers and isinstance(found.get("crs"), str)):
        message = "coordinate_reference is not {crs: string, origin: [x, y, z]} (SPEC §7.10)"
        raise Malformed("bad-metadata", message, offset=offset, field="METADATA")


def read_metadata(container: Container) -> dict[str, Any] | None:
    """The METADATA block's JSON object; None when there is none, or a truncated source does not reach it.

    Raises:
        Malformed: ``bad-metadata``: it breaks R-7.10-1, as :func:`parse_metadata` says.
        LimitExceeded: ``limit-metadata``: it has more bytes than the container's limits allow, or is nested deeper than
            the format allows.
    """
    entry = container.find(BlockKind.METADATA, 1)
    if entry is None or not container.is_available(entry):
        return None
    if entry.length > container.limits.metadata_bytes:
        message = f"{entry.length} bytes exceed this reader's limit of {container.limits.metadata_bytes}"
        raise LimitExceeded("limit-metadata", message, offset=entry.offset, field="METADATA")
    return parse_metadata(container.read_block(entry), entry.offset)


def describe(container: Container) -> Description:
    """What the header and METADATA say about the scene; of METADATA that cannot be used, nothing.

    Warns:
        InputWarning: METADATA breaks its rules.
    """
    said = Description.of_header(container.header.fields)
    try:
        metadata = read_metadata(container) or {}
        check_registered(metadata)
    except (Malformed, LimitExceeded) as error:
        warnings.warn(f"the up axis and coordinate reference are unknown: {error}", InputWarning, stacklevel=2)
        return said
    return said.with_metadata(metadata)


def nesting(data: bytes) -> int:
    """How many brackets are open at once at most, those in strings aside, in any bytes (R-7.10-3)."""
    brackets = _STRING.sub(b"", data).translate(None, delete=_NO_BRACKETS)
    return max(accumulate(map(_STEP.__getitem__, brackets), initial=0))


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is not JSON")


def _finite(text: str) -> float:
    number = float(text)
    if math.isinf(number):
        raise ValueError(f"{text[:20]} is beyond binary64")
    return number


def _whole(text: str) -> int:
    # At most 309 digits are left after this, fewer than interpreters refuse to convert.
    _finite(text)
    return int(text)
