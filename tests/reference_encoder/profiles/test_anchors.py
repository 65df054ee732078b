"""The anchor profile: a small model survives encoding; what is invisible is dropped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference_decoder.anchors import gaussians
from reference_decoder.decode import decode
from reference_encoder.encode import EncodeOptions, encode
from reference_encoder.importance.anchor_sensitivity import measure_anchors
from reference_encoder.importance.view_sampling import GIVEN, Views
from scarfmt.container.source import BytesSource
from scarfmt.formats import load
from scarfmt.render.camera import Camera, look_at
from scarfmt.render.capture import load_cameras
from scarfmt.render.metrics import psnr
from scarfmt.render.rasterise import render
from scarfmt.render.viewpoints import Upright
from scarfmt.scene.gaussians import AnchorModel, Mlp
from scarfmt.tools.inspection import inspect
from scarfmt.tools.validate import validate
from tests.samples.codec_samples import refuses


def small_model(count: int = 300, slots: int = 4, width: int = 8) -> AnchorModel:
    """Random anchors and networks whose opacities are positive about half the time."""
    draw = np.random.default_rng(5)

    def net(outputs: int, bias: float) -> Mlp:
        first = draw.normal(0, 0.5, (16, width + 4)).astype(np.float32)
        second = draw.normal(0, 0.4, (outputs, 16)).astype(np.float32)
        return Mlp((first, second), (np.zeros(16, np.float32), np.full(outputs, bias, np.float32)))

    return AnchorModel(
        draw.normal(size=(count, 3)),
        draw.normal(0, 1, (count, width)).astype(np.float32),
        draw.normal(0, 0.5, (count, slots, 3)).astype(np.float32),
        np.log(draw.uniform(0.05, 0.2, (count, 6))).astype(np.float32),
        {"opacity": net(slots, 0.3), "cov": net(7 * slots, 0.2), "color": net(3 * slots, 0.0)},
    )


def ring(count: int) -> list[Camera]:
    """Cameras round the origin."""
    turns = np.linspace(0, 2 * np.pi, count, endpoint=False)
    eyes = [np.array([4 * np.cos(t), -1.5, 4 * np.sin(t)]) for t in turns]
    return [look_at(eye, np.zeros(3), np.array([0.0, -1, 0]), 160, 120) for eye in eyes]


def picture(model: AnchorModel, camera: Camera) -> np.ndarray:
    """The picture of an anchor model from one camera."""
    made = gaussians(model, camera.centre)
    return np.asarray(render(made.scene, camera, colours=made.colours))


def nearest(places: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(M,) which of (N, 3) `places` is nearest to each of (M, 3) `wanted`."""
    return np.asarray(np.linalg.norm(wanted[:, None] - places[None], axis=2).argmin(axis=1))


def test_anchor_model_round_trip() -> None:
    """Every layer is a valid file's prefix; the last looks like the source; bytes repeat."""
    model, cameras = small_model(), ring(6)
    options = EncodeOptions(quality=42, effort=1, layers=3, cameras=cameras)
    data = encode(model, options)
    assert encode(model, options) == data
    assert not [f for f in validate(BytesSource(data)).findings if f.severity == "error"]
    held_out = ring(5)[1]
    layers = inspect(BytesSource(data))["layer_count"]
    found = [
        psnr(picture(model, held_out), picture(decode(data, layers=layer).scene, held_out))
        for layer in range(1, layers + 1)
    ]
    assert found == sorted(found)
    assert found[-1] > 41


def test_what_no_network_reads_costs_nothing() -> None:
    """Noise in features that feed no network adds next to no bytes: the networks' Jacobian prices errors."""
    model, options = small_model(), EncodeOptions(quality=42, effort=1, layers=3, cameras=ring(4))
    unread = slice(4, 8)
    mlps = {}
    for name, mlp in model.mlps.items():
        first = mlp.weights[0].copy()
        first[:, unread] = 0
        mlps[name] = Mlp((first, mlp.weights[1]), mlp.biases)
    quiet = model.features.copy()
    quiet[:, unread] = 0
    sizes = [len(encode(replace(model, features=f, mlps=mlps), options)) for f in (quiet, model.features)]
    assert sizes[1] < 1.05 * sizes[0]


def test_slots_turn_on_over_the_layers_the_most_visible_first() -> None:
    """The first layer spends its bytes on the slots that show most, not on every slot of its anchors."""
    model, cameras = small_model(), ring(4)
    data = encode(model, EncodeOptions(quality=42, effort=1, layers=3, cameras=cameras))
    first, last = decode(data, layers=1).scene, decode(data).scene
    assert first.slot_mask is not None
    near = nearest(last.anchors, first.anchors)
    early, ever = first.slot_mask, last.slot_mask[near]
    assert not (early & ~ever).any()
    assert 0.1 * ever.sum() < early.sum() < 0.6 * ever.sum()
    source = nearest(model.anchors, first.anchors)
    seen = measure_anchors(
        model, Views({GIVEN: cameras}, {GIVEN: 1.0}, 1.0, Upright("-y")), 0, lambda _fraction: None
    ).shape[source]
    assert np.median(seen[early]) > 3 * np.median(seen[ever & ~early])


def test_networks_are_required() -> None:
    """An anchor model without its networks cannot be judged or drawn."""
    model = small_model()
    bare = AnchorModel(model.anchors, model.features, model.offsets, model.log_scaling)
    refuses("input-anchors", lambda: encode(bare, EncodeOptions(effort=1, cameras=ring(2))))


@pytest.mark.slow
@pytest.mark.scene
def test_real_anchor_model(shared_data: Path) -> None:
    """The trained model of plush-on-bed: at most a twelfth of its raw size, under 0.6 dB lost on the photos."""
    from scarfmt.render.compare import compare_with_photos

    model = load(shared_data / "anchors" / "plush-on-bed.npz")
    photos = shared_data / "photos" / "plush-on-bed"
    data = encode(model, EncodeOptions(quality=42, cameras=load_cameras(photos / "cameras.json")))
    raw = model.anchors.size * 4 + model.features.nbytes + model.offsets.nbytes + model.log_scaling.nbytes
    assert len(data) < raw / 12
    decoded = decode(data).scene
    before, after = (
        compare_with_photos(lambda camera, m=m: picture(m, camera), photos, ssim=False) for m in (model, decoded)
    )
    assert after.mean_psnr_db > before.mean_psnr_db - 0.6
