"""JSON Schemas (draft 2020-12) of ``manifest.json`` and ``expect.json``."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from conformance.decoders.python.container import FILE_HEADER, HEADER_CHECKSUM, LAYER_SUMMARY, Layout
from conformance.decoders.python.front import Entry, Tile
from conformance.expect.document import BITSTREAM, FORMAT
from conformance.expect.stages import EXACT

CLASSES = ("valid", "edge", "invalid", "either", "truncated")
RESULTS = ("decoded", "refused", "either")
REFUSAL_STAGES = ("container", "models", "tiles", "metadata", "streaming")
LICENCE = "CC0-1.0"

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_ID = {"type": "string", "pattern": "^(worked|(valid|edge|invalid|either|truncated)/[a-z0-9]+(-[a-z0-9]+)*)$"}
_WORD = {"type": "string", "pattern": "^[a-z0-9]+(-[a-z0-9]+)*$"}
_RULE = {"type": "string", "pattern": r"^R-[0-9]+(\.[0-9]+)?-[0-9]+$"}
_SHA256 = {"type": "string", "pattern": "^[0-9a-f]{64}$"}
_COUNT = {"type": "integer", "minimum": 0}
_LAYER = {"type": "integer", "minimum": 1, "maximum": 16}
_PROFILE = {"enum": ["explicit", "anchor", None]}
_SHAPE = {"type": "array", "items": _COUNT, "minItems": 1, "maxItems": 4}

_STREAM = "(POSITIONS|CLASSES|MASKS|POSITION_RESIDUAL|SCALE|ROTATION|OPACITY|COLOUR|INDICES|LATENT|OFFSETS)"
_ARRAY_NAMES = {
    "models": r"^(codebook\.[01]|grid\.bits\.(1[0-5]|[0-9]))$",
    "context": r"^(grid\.features|embedding|"
    r"context\.(SCALE|ROTATION|OPACITY|COLOUR|LATENT)\.[0-9]+\.([1-9]|1[0-9]|20))$",
    "frequencies": rf"^frequencies\.({_STREAM}|INDICES\.[1-8])$",
    "indices": "^index$",
    "integers": rf"^(tile|code|class|slot_layer|v\.{_STREAM})$",
    "sums": "^codeword_sum$",
    "values": rf"^(position|latent|value\.{_STREAM})$",
}
_DTYPES = ["|u1", "<u2", "<u4", "<u8", "<i4", "<f4", "<f8"]
_ACTIVATED_NAME = r"(rotation|logit|opacity|sh|feature|gaussian\.(opacity|scale|rotation|colour|centre))"
_NUMBERS = {
    "bytes": {"type": "string", "pattern": "^[0-9a-f]{18}$"},
    "f64": {"type": "string", "pattern": "^[0-9a-f]{16}$"},
}
_DECIMAL = {"type": "string", "pattern": "^(0|[1-9][0-9]{0,19})$"}


def _object(properties: dict[str, Any], optional: tuple[str, ...] = ()) -> dict[str, Any]:
    """An object of exactly these properties."""
    required = [name for name in properties if name not in optional]
    return {"type": "object", "additionalProperties": False, "required": required, "properties": properties}


def _named(pattern: str, value: dict[str, Any]) -> dict[str, Any]:
    """An object whose keys match a pattern, at least one."""
    return {
        "type": "object", "minProperties": 1, "additionalProperties": False, "patternProperties": {pattern: value},
    }


def _list(items: dict[str, Any], least: int = 0, unique: bool = False) -> dict[str, Any]:
    return {"type": "array", "items": items, "minItems": least, **({"uniqueItems": True} if unique else {})}


def _structure(*layouts: Layout) -> dict[str, Any]:
    numbers = {}
    for name, kind, count in (field for layout in layouts for field in layout):
        number = _NUMBERS.get(kind, _DECIMAL)
        single = kind == "bytes" or count == 1
        numbers[name] = number if single else {**_list(number, count), "maxItems": count}
    return _object(numbers)


def _stages() -> dict[str, Any]:
    array = _object({
        "dtype": {"enum": _DTYPES},
        "shape": _SHAPE,
        "sha256": _SHA256,
        "first": {**_list({"type": "number"}), "maxItems": 8},
    })
    reference = _object({
        "shape": _SHAPE,
        "reference": {"type": "string", "pattern": rf"^activated/[0-9]+-{_ACTIVATED_NAME}\.bin$"},
        "magnitude": {"type": "boolean"},
    })
    container = _object({
        "header": _structure(FILE_HEADER, HEADER_CHECKSUM),
        "layers": _list(_structure(LAYER_SUMMARY), 1),
        "tiles": _list(_object(dict.fromkeys(Tile._fields, _DECIMAL))),
        "entries": _list(_object({field.name: _DECIMAL for field in fields(Entry)})),
    })
    stages = {"container": _object({"container": container})}
    stages |= {stage: _object({"arrays": _named(_ARRAY_NAMES[stage], array)}) for stage in EXACT}
    stages["activated"] = _object({"arrays": _named(f"^{_ACTIVATED_NAME}$", reference)})
    return _object(stages, tuple(name for name in stages if name not in ("indices", "integers", "values")))


def expect_schema() -> dict[str, Any]:
    """The JSON schema of ``expect.json``."""
    properties: dict[str, Any] = {
        "format": {"const": FORMAT},
        "id": _ID,
        "class": {"enum": list(CLASSES)},
        "purpose": {"type": "string", "minLength": 1},
        "profile": _PROFILE,
        "features": _list(_WORD, unique=True),
        "rules": _list(_RULE, unique=True),
        "file": _object({"bytes": _COUNT, "sha256": _SHA256}),
        "extend_to": {"type": "integer", "minimum": 1},
        "result": {"enum": list(RESULTS)},
        "refusal": _WORD,
        "stage": {"enum": list(REFUSAL_STAGES)},
        "offsets": {**_list(_COUNT, 2), "maxItems": 2},
        "refusals": _list(_WORD, 1, unique=True),
        "from": _ID,
        "to_layer": _LAYER,
        "camera": {**_list({"type": "number"}, 3), "maxItems": 3},
        "layers": _list(_object({"layer": _LAYER, "anchors": _COUNT, "stages": _stages()}), 1),
        "metadata": {"type": ["object", "null"]},
        "streaming": {"type": ["object", "null"]},
    }
    optional = (
        "extend_to", "refusal", "stage", "offsets", "refusals", "from", "to_layer", "camera", "layers", "metadata",
        "streaming",
    )  # fmt: skip
    return {
        "$schema": _DRAFT,
        "title": "What a decoder must make of one conformance vector",
        **_object(properties, optional),
        "dependentRequired": {
            "from": ["to_layer"], "to_layer": ["from"],
            **{name: ["layers"] for name in ("metadata", "streaming", "camera")},
        },
        "oneOf": [
            _result("decoded", needed=("layers",), absent=("refusal", "stage", "offsets", "refusals")),
            _result("refused", needed=("refusal", "stage"), absent=("refusals", "layers")),
            _result("either", needed=("refusals",), absent=("refusal", "stage", "offsets")),
        ],
    }


def _result(result: str, needed: tuple[str, ...], absent: tuple[str, ...]) -> dict[str, Any]:
    properties = {"result": {"const": result}, **dict.fromkeys(absent, False)}
    return {"required": list(needed), "properties": properties}


def manifest_schema() -> dict[str, Any]:
    """The JSON schema of ``manifest.json``."""
    vector: dict[str, Any] = _object(
        {
            "id": _ID,
            "class": {"enum": list(CLASSES)},
            "file": {"type": "string", "pattern": "^vectors/[a-z0-9/-]+/input\\.scar$"},
            "expect": {"type": "string", "pattern": "^vectors/[a-z0-9/-]+/expect\\.json$"},
            "bytes": _COUNT,
            "sha256": _SHA256,
            "profile": _PROFILE,
            "features": _list(_WORD, unique=True),
            "rules": _list(_RULE, unique=True),
            "result": {"enum": list(RESULTS)},
            "refusal": _WORD,
            "refusals": _list(_WORD, 1, unique=True),
            "layers": {"type": "integer", "minimum": 0, "maximum": 16},
            "since": {"type": "string", "pattern": "^[0-9]+\\.[0-9]+$"},
        },
        ("refusal", "refusals"),
    )
    vector["oneOf"] = [
        _result("decoded", needed=(), absent=("refusal", "refusals")),
        _result("refused", needed=("refusal",), absent=("refusals",)),
        _result("either", needed=("refusals",), absent=("refusal",)),
    ]
    return {
        "$schema": _DRAFT,
        "title": "The conformance vectors of the .scar file format",
        **_object({
            "format": {"const": FORMAT},
            "bitstream": {"const": BITSTREAM},
            "licence": {"const": LICENCE},
            "vectors": _list(vector, 1, unique=True),
        }),
    }
