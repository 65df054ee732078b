"""The encoder's promises: determinism, truncation, layers that get better, options that mean something."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference_decoder.decode import decode
from reference_encoder.encode import Encoded, EncodeOptions, encode
from scarfmt.container.source import BytesSource
from scarfmt.formats import load
from scarfmt.render.camera import orbit_cameras
from scarfmt.render.compare import compare
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.tools.inspection import inspect

OPTIONS = EncodeOptions(effort=1, layers=4, quality=40)


@pytest.fixture(scope="module")
def scene() -> GaussianScene:
    """Four thousand Gaussians on three coloured, view-dependent spheres."""
    draw = np.random.default_rng(1)
    count = 4000
    normal = draw.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    centre = np.array([[0.0, 0, 0], [2.5, 0, 0], [0, 0, 2.5]])[draw.integers(0, 3, count)]
    sh = draw.normal(0, 0.05, (count, 9, 3)).astype(np.float32)
    sh[:, 0] += (np.sin(3 * normal) + centre * 0.3).astype(np.float32)
    sh[:, 1:4] += (0.2 * normal[:, :, None]).astype(np.float32)
    return GaussianScene(
        centre + normal,
        np.log(draw.uniform(0.01, 0.09, (count, 3))).astype(np.float32),
        draw.normal(size=(count, 4)).astype(np.float32),
        draw.normal(1, 2, count).astype(np.float32),
        sh,
    )


@pytest.fixture(scope="module")
def data(scene: GaussianScene) -> Encoded:
    """The scene, encoded."""
    return encode(scene, OPTIONS)


def test_every_layer_looks_better(scene: GaussianScene, data: bytes) -> None:
    """PSNR against the source rises with every layer, and the last is near the quality asked for."""
    cameras = orbit_cameras(scene, 3, width=240, height=180)
    layers = inspect(BytesSource(data))["layer_count"]
    found = [
        compare(scene, decode(data, layers=layer).scene, cameras, ssim=False).mean_psnr_db
        for layer in range(1, layers + 1)
    ]
    assert found == sorted(found)
    assert found[-1] > 37


@pytest.mark.parametrize("effort", [1, 2])
def test_quality_is_what_was_asked_for(scene: GaussianScene, effort: int) -> None:
    """Over views that nothing was decided by; the file says the same, and what the user annotated."""
    made = encode(scene, EncodeOptions(effort=effort, layers=3, quality=38, metadata={"title": "spheres"}))
    assert made.quality.mean_db == pytest.approx(38, abs=0.5)
    assert made.quality.worst_db <= made.quality.low_db < made.quality.mean_db
    metadata = inspect(BytesSource(made), metadata=True)["metadata"]
    assert metadata["title"] == "spheres"
    assert metadata["quality"] == made.quality.figures()


def test_what_the_user_annotates_is_kept(scene: GaussianScene) -> None:
    """Even under the name that the encoder has for what it found."""
    options = replace(OPTIONS, metadata={"quality": "good"}, corrections=0)
    assert inspect(BytesSource(encode(scene, options)), metadata=True)["metadata"]["quality"] == "good"


def test_a_draft_is_about_as_good_as_asked(scene: GaussianScene) -> None:
    """Nothing is corrected, and the file says how good it is with a standard error."""
    made = encode(scene, EncodeOptions(effort=0, layers=2, quality=40))
    assert made.quality.mean_db == pytest.approx(40, abs=6)
    assert 0 < made.quality.error_db < 6
    assert "±" in made.quality.verdict()


def test_worst_asks_for_a_floor(scene: GaussianScene) -> None:
    """The 5th percentile in place of the mean."""
    made = encode(scene, EncodeOptions(effort=1, layers=2, worst=32))
    assert made.quality.low_db == pytest.approx(32, abs=1)
    assert made.quality.mean_db > 34


@pytest.mark.scene
def test_real_scene_beats_the_smallest_rival(shared_data: Path) -> None:
    """plush-dog at 40.2 dB or more takes less than half of SOG's 36.9 bytes per Gaussian at that quality."""
    source = load(shared_data / "splats" / "plush-dog.ply")
    assert isinstance(source, GaussianScene)
    file = encode(source, EncodeOptions(effort=1, quality=41))
    quality = compare(source, decode(file).scene, orbit_cameras(source, 4), ssim=False).mean_psnr_db
    assert len(file) / len(source) < 36.9 / 2
    assert quality > 40.2
