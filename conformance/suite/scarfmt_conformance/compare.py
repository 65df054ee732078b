"""An answer against what is pinned: the first stage and array that differ (conformance/PROTOCOL.md, "Stages")."""

from __future__ import annotations

import base64
import binascii
import json
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scarfmt.arrays import F64
from scarfmt.errors import InvalidInput
from scarfmt_conformance.protocol import STAGES, printable

TOLERANCE = 1e-5
LARGEST_COMPARED = 1e38
"""Beyond, numbers may have overflowed in binary32 (SPEC §9.5)."""
_NUMBERS_SHOWN = 8
_ACTIVATED_TYPES = ("<f4", "<f8")
_MISSING = object()
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Difference:
    """One thing that is not as pinned.

    Attributes:
        stage: one of `STAGES`.
        array: name of the array, or path of the field; empty where the whole stage is wrong.
        message: what is wrong.
        expected: what is pinned, for people; may be empty.
        got: what the decoder gave, for people, printable; may be empty.
    """

    stage: str
    array: str
    message: str
    expected: str = ""
    got: str = ""


def pinned_stages(stages: dict[str, Any], claimed: Iterable[str]) -> list[str]:
    """The stages, in order, that are claimed and have something pinned."""
    wanted = set(claimed)
    return [stage for stage in STAGES if stage in wanted and _contents(stage, stages.get(stage))]


def _contents(stage: str, pinned: Any) -> Any:
    if not isinstance(pinned, dict):
        return None
    return pinned.get("container", pinned) if stage == "container" else pinned.get("arrays")


def differences(stage: str, pinned: Any, answered: Any, folder: Path) -> list[Difference]:
    """The differences in a stage, in the order of the pinned values.

    Args:
        stage: one of `STAGES` that is no annotation.
        pinned: of ``expect.json``.
        answered: anything; None if the stage is absent.
        folder: of ``expect.json``, where references lie.

    Raises:
        InvalidInput: ``input-suite``: a reference cannot be read.
    """
    key = "container" if stage == "container" else "arrays"
    contents = answered.get(key) if isinstance(answered, dict) else None
    if not isinstance(contents, dict):
        fault = "is claimed, but is not in the answer" if answered is None else f"is not an object with {key}"
        return [Difference(stage, "", f"the stage {fault}")]
    if stage == "container":
        return list(_field_differences("", _contents(stage, pinned), contents))
    out = []
    for name, expected in pinned["arrays"].items():
        got = contents.get(name)
        if not isinstance(got, dict):
            found = [Difference(stage, name, "is missing" if got is None else "is not an object", _show(expected))]
        elif "reference" in expected:
            found = _compare_activated(name, expected, got, folder)
        else:
            found = _exact_differences(stage, name, expected, got)
        out += found
    return out


def _field_differences(path: str, expected: Any, got: Any) -> Iterator[Difference]:
    """Fields of the container that differ; those that are not pinned are ignored."""
    if isinstance(expected, dict) and isinstance(got, dict):
        for name, value in expected.items():
            yield from _field_differences(f"{path}.{name}" if path else name, value, got.get(name, _MISSING))
    elif isinstance(expected, list) and isinstance(got, list):
        if len(expected) != len(got):
            yield Difference("container", path, "has another length", str(len(expected)), str(len(got)))
            return
        for index, (value, other) in enumerate(zip(expected, got, strict=True)):
            yield from _field_differences(f"{path}[{index}]", value, other)
    elif got is _MISSING:
        yield Difference("container", path, "is missing", _value(expected))
    elif type(expected) is not type(got) or expected != got:
        yield Difference("container", path, "differs", _value(expected), _value(got))


def _value(value: Any) -> str:
    if isinstance(value, dict | list):
        return "an object" if isinstance(value, dict) else "a list"
    return printable(repr(value), 80)


def _exact_differences(stage: str, name: str, expected: dict[str, Any], got: dict[str, Any]) -> list[Difference]:
    for field, fault in (("dtype", "has another type"), ("shape", "has another shape"), ("sha256", "differs")):
        value = got.get(field)
        sane = _is_shape(value) if field == "shape" else isinstance(value, str)
        if not sane or value != expected[field]:
            return [Difference(stage, name, fault, _show(expected), _show(got))]
    return []


def _is_shape(value: Any) -> bool:
    # bool is an int to Python, and true no number to JSON.
    return isinstance(value, list) and all(type(item) is int and 0 <= item < 1 << 63 for item in value)


def _show(array: dict[str, Any]) -> str:
    """An array for people: type, shape, start of the hash, first values."""
    parts = [printable(str(array.get("dtype", "")), 20), _shape_text(array.get("shape")), _hash_text(array)]
    first = array.get("first")
    if isinstance(first, list) and first:
        numbers = [printable(repr(item), 24) for item in first[:_NUMBERS_SHOWN] if isinstance(item, int | float | str)]
        parts.append("first " + " ".join(numbers))
    return " ".join(part for part in parts if part)


def _shape_text(shape: Any) -> str:
    if not _is_shape(shape):
        return "no shape" if shape is None else f"shape {printable(repr(shape), 40)}"
    return "(" + ", ".join(map(str, shape[:8])) + ")"


def _hash_text(array: dict[str, Any]) -> str:
    value = array.get("sha256")
    if value is None:
        return ""
    return f"sha256 {value[:16]}..." if isinstance(value, str) and _SHA256.fullmatch(value) else "no valid sha256"


# ------------------------------------------------------------------------------------------------ activated values


def _compare_activated(name: str, expected: dict[str, Any], got: dict[str, Any], folder: Path) -> list[Difference]:
    shape = tuple(expected["shape"])
    text = _shape_text(list(shape))
    if not _is_shape(got.get("shape")) or tuple(got["shape"]) != shape:
        return [Difference("activated", name, "has another shape", text, _shape_text(got.get("shape")))]
    values = _numbers(got, shape)
    if isinstance(values, str):
        return [Difference("activated", name, values, text)]
    reference, magnitude = _reference(expected, shape, folder)
    return _beyond(name, reference, magnitude, values)


def _numbers(array: dict[str, Any], shape: tuple[int, ...]) -> F64 | str:
    """The numbers of an answered array, or why there are none."""
    dtype, data = array.get("dtype"), array.get("data")
    if dtype not in _ACTIVATED_TYPES:
        return f"is of type {printable(repr(dtype), 40)}, not <f4 or <f8"
    if not isinstance(data, str):
        return "has no data"
    try:
        raw = base64.b64decode(data.encode("ascii"), validate=True)
    except (binascii.Error, UnicodeEncodeError) as error:
        return f"has data that is not base64 ({printable(str(error), 80)})"
    size = math.prod(shape) * int(dtype[2])
    if len(raw) != size:
        return f"has {len(raw):,} bytes of data, not {size:,}"
    return np.frombuffer(raw, dtype).astype(np.float64).reshape(shape)


def _reference(expected: dict[str, Any], shape: tuple[int, ...], folder: Path) -> tuple[F64, F64]:
    """Reference and magnitudes m of SPEC §9.5, both of the shape pinned."""
    path = folder / expected["reference"]
    parts = 2 if expected.get("magnitude") else 1
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InvalidInput("input-suite", f"{path}: {error.strerror}") from error
    if len(raw) != 8 * parts * math.prod(shape):
        raise InvalidInput("input-suite", f"{path}: it has {len(raw)} bytes, not those of its shape {shape}")
    numbers = np.frombuffer(raw, "<f8").reshape(parts, *shape).astype(np.float64)
    return numbers[0], np.abs(numbers[-1])


def _beyond(name: str, reference: F64, magnitude: F64, values: F64) -> list[Difference]:
    with np.errstate(all="ignore"):
        most = np.maximum(magnitude, np.abs(reference))
        tolerance = TOLERANCE * np.maximum(1.0, most)
        wrong = ~(np.abs(values - reference) <= tolerance) & (most <= LARGEST_COMPARED)
    if not wrong.any():
        return []
    first = tuple(int(i) for i in np.argwhere(wrong)[0])
    place = ", ".join(map(str, first))
    count = f"{int(wrong.sum()):,} of {wrong.size:,} values are beyond the tolerance, first at [{place}]"
    got = f"{values[first]!s}, off by {abs(values[first] - reference[first]):.3g}"
    return [Difference("activated", name, count, f"{reference[first]!s} ± {tolerance[first]:.3g}", got)]


# ------------------------------------------------------------------------------------------------ annotations


def annotation_difference(stage: str, pinned: Any, answered: Any) -> Difference | None:
    """A difference of an annotation; numbers are compared as binary64, in which most languages keep them.

    Args:
        stage: ``metadata`` or ``streaming``.
        pinned: an object, or None if the file has none.
        answered: what the answer has for the stage.
    """
    if not isinstance(answered, dict) or stage not in answered:
        fault = "the stage is not in the answer" if answered is None else f"the stage is not an object with {stage}"
        return Difference(stage, "", fault)
    if _equal(pinned, answered[stage]):
        return None
    return Difference(stage, stage, "differs", _json_text(pinned), _json_text(answered[stage]))


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_equal(a[key], b[key]) for key in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(_equal, a, b))
    if isinstance(a, bool) or isinstance(b, bool):
        return a is b
    if isinstance(a, int | float) and isinstance(b, int | float):
        return a == b or _binary64(a) == _binary64(b)
    return type(a) is type(b) and bool(a == b)


def _binary64(number: float) -> float:
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def _json_text(value: Any) -> str:
    try:
        return printable(json.dumps(value), 120)
    except RecursionError:
        return "something nested deeply"
