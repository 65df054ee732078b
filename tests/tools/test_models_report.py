"""inspect --models: what codes the symbols of a file."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from scarfmt.coding.decoder_model import DECODER, MECHANISMS
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.tools.models_report import describe_models, format_models


def test_a_static_file_says_so() -> None:
    """No predictors, no network, nothing to multiply."""
    report = describe_models(BytesSource(write_scene(random_scene(5))))
    assert report["predictors"] == {}
    assert report["index_network"] is None
    assert report["multiply_adds"] == 0
    assert "none: static tables" in format_models(report)


def test_networks_are_described_as_the_file_holds_them() -> None:
    """Counts, shapes and bytes of the scene that was written; JSON-able."""
    scene = neural_scene(3, Profile.EXPLICIT)
    assert scene.network is not None
    assert scene.grid is not None
    report = json.loads(json.dumps(describe_models(BytesSource(write_scene(scene)))))
    assert sum(report["predictors"].values()) == sum(map(len, scene.predictors.values()))
    network = report["index_network"]
    assert network["hidden"] == scene.network.hidden
    assert network["attention"] == (scene.network.attention is not None)
    assert network["layers"] == [n for n, row in enumerate(scene.model.layers, start=1) if row.neural]
    assert report["hash_grid"] == {"levels": len(scene.grid.levels), "features": scene.grid.width}
    assert report["context"]["passes"] == scene.model.context.passes_log2 + 1
    single = sum(p.multiply_adds for group in scene.predictors.values() for p in group)
    assert report["multiply_adds"] == single + scene.network.multiply_adds(scene.model.max_stages)
    assert set(report["blocks"]) >= {"layer", "entropy_network", "hash_grid"}
    text = format_models(report)
    assert f"H = {scene.network.hidden}" in text


def test_what_networks_save_and_take_is_told() -> None:
    """Bytes as the encoder says, time by the model of a decoder, and the bandwidth at which both are worth the same."""
    index = {"saved": 1000, "multiply_adds": 10**9, "anchors": 10**6}
    scale = {"saved": -5, "multiply_adds": 2000, "anchors": 10}
    told = {"predictors": {"scale": scale}, "index_network": index}
    scene = replace(random_scene(5), metadata={MECHANISMS: told})
    report = describe_models(BytesSource(write_scene(scene)))
    first, second = report["mechanisms"]
    assert (first["name"], first["saved_bytes"], first["pays_below_mbit"]) == ("predictors, scale", -5, 0)
    assert (second["name"], second["multiply_adds"]) == ("index network", 10**9)
    assert second["ms"] == pytest.approx(DECODER.index_network_ns(10**9, 10**6) / 1e6)
    assert second["pays_below_mbit"] == pytest.approx(8 * 1000 / 1e6 / (second["ms"] / 1e3))
    assert "1,000 bytes saved" in format_models(report)


@pytest.mark.parametrize(
    "told",
    [5, None, {"predictors": 5}, {"index_network": [1]}, {"index_network": {"saved": "1"}}]
    + [{"index_network": {"saved": 1, "multiply_adds": value, "anchors": 1}} for value in (True, 1.5, 1 << 64)],
)
def test_metadata_of_somebody_else_is_no_error(told: Any) -> None:
    """METADATA is any JSON: entries that no encoder writes are ignored."""
    scene = replace(random_scene(5), metadata={MECHANISMS: told})
    assert describe_models(BytesSource(write_scene(scene)))["mechanisms"] == []
