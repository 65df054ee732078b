"""What must be in the file of a vector: integers and models by its scene, the rest by the readable decoder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conformance.decoders.python.answers import Answers
from scarfmt.blocks.streaming import Streaming
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Profile

Arrays = dict[str, NDArray[Any]]


def scene_arrays(scene: QuantisedScene) -> Arrays:
    """The arrays of the stages ``models``, ``indices`` and ``integers`` by their names in PROTOCOL.md, anchors in
    normative order (SPEC §6.3)."""
    contents = scene.contents or (TileContent.empty(scene.model),)
    out: Arrays = {
        "tile": np.repeat(np.arange(len(contents), dtype="<u4"), [len(content) for content in contents]),
        "code": _join([content.codes for content in contents], "<u8"),
        "class": _join([content.classes for content in contents], "u1"),
        "index": _join([content.indices for content in contents], "<u2"),
    }
    if scene.fields.profile == Profile.ANCHOR:
        out["slot_layer"] = _join([content.slot_layers for content in contents], "u1")
    for number, channel in enumerate(scene.model.channels):
        out[f"v.{channel.stream.name}"] = _join([content.values[number] for content in contents], "<i4")
    return {**out, **_models(scene)}


def _join(parts: Sequence[NDArray[Any]], dtype: str) -> NDArray[Any]:
    return np.concatenate(parts).astype(dtype)


def _models(scene: QuantisedScene) -> Arrays:
    out: Arrays = {}
    most = max(scene.model.layers[-1].stages)
    if scene.codebooks is not None:
        # Book 0 arrives with the first stage, book 1 with the second (SPEC §7.8).
        books = (scene.codebooks.coarse, scene.codebooks.residual)[:most]
        out = {f"codebook.{b}": book.astype("<i4") for b, book in enumerate(books)}
    # The grid arrives with the first layer that needs it (SPEC §10.4).
    if scene.grid is not None and any(row.neural for row in scene.model.layers):
        out |= {f"grid.bits.{number}": bits.astype("u1") for number, bits in enumerate(scene.grid.bits)}
    return out


def decoded_arrays(answers: Answers) -> Arrays:
    """The integers of a file, and the sums and values that follow from them, as the readable decoder has them."""
    found = {**answers.integers(), **answers.sums(), **answers.values()}
    return {name: np.array(array.values, array.dtype).reshape(array.shape) for name, array in found.items()}


def expected_streaming(told: Streaming) -> dict[str, Any]:
    """The expected STREAMING values, in the form of PROTOCOL.md."""
    view = told.view
    numbers = [] if view is None else [*view.position, *view.target, *view.up, view.fov]
    return {
        "view": _bits(numbers) or None,
        "low": told.low.tolist(),
        "high": told.high.tolist(),
        "reach": told.reach.tolist(),
    }


def _bits(numbers: Sequence[float]) -> list[str]:
    """The bits of numbers rounded to f32, most significant first."""
    return [np.array([number], ">f4").tobytes().hex() for number in numbers]
