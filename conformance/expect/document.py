"""``expect.json`` and the files beside it, of one vector."""

from __future__ import annotations

import hashlib
import json
import re
from typing import Any

from conformance.decoders.python.answers import EXACT, Answers, Array, pin
from conformance.decoders.python.container import METADATA_KIND, annotation, container_fields, profile_of
from conformance.decoders.python.decoder import Decoder
from conformance.decoders.python.front import Limits
from conformance.decoders.python.streaming import read_streaming
from conformance.expect.activated import Activated, activate
from conformance.expect.expectations import Arrays, decoded_arrays, expected_streaming, scene_arrays
from conformance.expect.features import features_of, is_core, list_rules
from conformance.expect.places import interval, places
from conformance.scenes.cases import Case
from scarfmt.coding.writer import QuantisedScene, keep_layers
from scarfmt.container.schema import Profile

FORMAT = "scar-conformance 2"
BITSTREAM = "0.3"
ACTIVATED_ANCHORS = 300
ACTIVATED_SLOTS = 1500
"""Activated values are pinned up to so many anchors and slots: each takes up to a kilobyte."""

_OF_THE_SCENE = ("models", "indices", "integers")
"""Stages that the scene itself tells; the others follow from them."""

Extra = dict[str, bytes]
_ANY = Limits(False, *[1 << 53] * 10)


def vector_class(id_: str) -> str:
    """The class of a vector, from its id; that of the worked file is ``valid``."""
    return id_.partition("/")[0] if "/" in id_ else "valid"


def expectation(case: Case) -> tuple[dict[str, Any], Extra]:
    """The content of ``expect.json`` of a vector, and its other files by their path in its folder.

    Raises:
        RuntimeError: the second decoder does not get from the file what its scene holds.
    """
    extra: Extra = {}
    features, rules = set(case.features), set(case.rules)
    profile = profile_of(case.data)
    if profile is not None:
        features.add(profile)
    if is_core(case.data, _ANY):
        features.add("core")
    decoded: dict[str, Any] = {}
    if case.scene is not None:
        decoded, extra, found = _describe_decoded(case, case.scene)
        features |= found
        rules |= list_rules(found)
    out: dict[str, Any] = {
        "format": FORMAT,
        "id": case.id,
        "class": vector_class(case.id),
        "purpose": case.purpose,
        "profile": profile,
        "features": sorted(features),
        "rules": sorted(rules, key=lambda rule: [int(part) for part in re.split("[-.]", rule)[1:]]),
        "file": {"bytes": len(case.data), "sha256": hashlib.sha256(case.data).hexdigest()},
    }
    if case.extend_to:
        out["extend_to"] = case.extend_to
    origin = {} if case.origin is None else {"from": case.origin, "to_layer": case.layers}
    return {**out, "result": case.result, **_refusals(case), **origin, **decoded}, extra


def _refusals(case: Case) -> dict[str, Any]:
    if case.result == "refused":
        place = places().get(case.id)
        offsets = {} if place is None else {"offsets": interval(case.data, place)}
        return {"refusal": case.refusals[0], "stage": case.stage, **offsets}
    return {"refusals": list(case.refusals)} if case.result == "either" else {}


def _describe_decoded(case: Case, scene: QuantisedScene) -> tuple[dict[str, Any], Extra, set[str]]:
    """``layers`` and ``metadata``, the files of activated values, the features."""
    decoders = [Decoder(case.data, k, _ANY) for k in range(1, (case.layers or len(scene.model.layers)) + 1)]
    answers = [Answers(decoder) for decoder in decoders]
    layers: list[dict[str, Any]] = []
    for number, answer in enumerate(answers, start=1):
        found = {stage: arrays for stage in EXACT if (arrays := answer.stage(stage))}
        _agree(case.id, found, scene_arrays(keep_layers(scene, number)))
        stages = {stage: {"arrays": arrays} for stage, arrays in found.items()}
        layers.append({"layer": number, "anchors": answer.n, "stages": stages})
    features = features_of(decoders[-1], answers[-1].n)
    if case.origin is not None:
        features.add("truncated")
    stages = layers[-1]["stages"]
    layers[-1]["stages"] = {"container": {"container": container_fields(case.data, _ANY)}, **stages}
    extra: Extra = {}
    camera: dict[str, Any] = {}
    anchors = answers[-1].n
    small = anchors <= ACTIVATED_ANCHORS and anchors * scene.model.slots <= ACTIVATED_SLOTS
    if vector_class(case.id) in ("valid", "edge") and small:
        if scene.fields.profile == Profile.ANCHOR:
            camera = {"camera": list(case.camera or scene.fields.origin)}
        arrays = activate(scene, decoded_arrays(answers[-1]), camera.get("camera"))
        made, extra = _describe_activated(arrays, len(layers))
        layers[-1]["stages"]["activated"] = made
        features |= _add_activated_features(features)
    return {**camera, "layers": layers, **_metadata(case), **_streaming(case)}, extra, features


def _agree(id_: str, found: dict[str, dict[str, Any]], arrays: Arrays) -> None:
    """Check that the readable decoder gets from the file what the scene holds."""
    read = {name: row for stage in _OF_THE_SCENE for name, row in found.get(stage, {}).items()}
    held = {name: pin(Array(array.dtype.str, array.shape, array.ravel().tolist())) for name, array in arrays.items()}
    if read != held:
        wrong = sorted(name for name in {*read, *held} if read.get(name) != held.get(name))
        raise RuntimeError(f"{id_}: the readable decoder gets other {', '.join(wrong)} than the scene has")


def _describe_activated(made: dict[str, Activated], layer: int) -> tuple[dict[str, Any], Extra]:
    paths = {name: f"activated/{layer}-{name}.bin" for name in made}
    rows = {
        name: {"shape": list(array.reference.shape), "reference": paths[name], "magnitude": array.magnitude is not None}
        for name, array in made.items()
    }
    return {"arrays": rows}, {paths[name]: array.to_bytes() for name, array in made.items()}


def _add_activated_features(features: set[str]) -> set[str]:
    out = {"activated", "activated-anchor" if "anchor" in features else "activated-explicit"}
    if "explicit" in features and "colour" in features:
        out.add("activated-colour")
    if "explicit" in features and "decoder-network" in features:
        out.add("activated-harmonics")
    return out


def _metadata(case: Case) -> dict[str, Any]:
    """The object of the METADATA block, None without one; nothing where none has to be found."""
    if case.result != "decoded":
        return {}
    block = annotation(case.data, METADATA_KIND, limits=_ANY)
    if block is None:
        return {"metadata": None}
    value = json.loads(block)
    assert case.scene is not None
    if case.scene.metadata and value != json.loads(json.dumps(dict(case.scene.metadata))):
        raise RuntimeError(f"{case.id}: the file has other metadata than the scene")
    return {"metadata": value}


def _streaming(case: Case) -> dict[str, Any]:
    """The expected STREAMING values; nothing if there are none, or if a decoder need not find them."""
    if case.result != "decoded" or case.scene is None or case.scene.streaming is None:
        return {}
    told = expected_streaming(case.scene.streaming)
    if read_streaming(case.data) != told:
        raise RuntimeError(f"{case.id}: the second decoder reads other streaming information than the scene has")
    return {"streaming": told}
