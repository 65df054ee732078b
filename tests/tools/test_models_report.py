"""inspect --models: what codes the symbols of a file."""

from __future__ import annotations

import json

from fuzz.testing.neural_scenes import neural_scene
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.container.source import BytesSource
from scarfmt.tools.models_report import describe_models, format_models


def test_networks_are_described_as_the_file_holds_them() -> None:
    """Counts, shapes and bytes of the scene that was written; JSON-able."""
    scene = neural_scene(4, Profile.EXPLICIT)
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
