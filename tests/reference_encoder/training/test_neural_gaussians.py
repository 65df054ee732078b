"""From anchors to Gaussians: as the reference decoder makes them (SPEC §9.6)."""

import numpy as np
import torch

from reference_decoder.anchors import gaussians
from reference_encoder.training.anchors import NETWORKS
from reference_encoder.training.neural_gaussians import expand, in_view
from scarfmt.scene.gaussians import AnchorModel, Mlp
from tests.reference_encoder.training import small


def test_gaussians_are_those_of_the_decoder() -> None:
    """Centres, sizes, opacities, colours of the slots that show agree with the normative formulas."""
    state, camera = small.state(), small.camera()
    rows = torch.arange(len(state.anchors))
    with torch.no_grad():
        values = state.exact(rows)
        g, owners, slots = expand(values, state.networks, torch.from_numpy(camera.centre))
        mlps = {
            name: Mlp(
                tuple(m[name].weight.numpy() for m in (state.networks.hidden, state.networks.output)),
                tuple(m[name].bias.numpy() for m in (state.networks.hidden, state.networks.output)),
            )
            for name in NETWORKS
        }
        model = AnchorModel(
            values.positions.double().numpy(),
            values.features.numpy(),
            values.offsets.numpy(),
            values.scaling.numpy(),
            mlps,
            values.shown.numpy(),
        )
    reference = gaussians(model, camera.centre)
    shown = 1 / (1 + np.exp(-reference.scene.opacity_logits.astype(np.float64))) >= 1 / 255
    assert np.array_equal(owners.numpy(), reference.anchors[shown])
    assert np.array_equal(slots.numpy(), reference.slots[shown])
    assert np.allclose(g.centres.numpy(), reference.scene.positions[shown], atol=1e-5)
    assert np.allclose(np.log(g.scales.numpy()), reference.scene.log_scales[shown], atol=1e-4)
    assert np.allclose(g.colours.numpy(), reference.colours[shown], atol=1e-5)


def test_nothing_that_shows_is_left_out_of_view() -> None:
    """The sphere round an anchor is generous: what is out of view touches no pixel."""
    state, camera = small.state(400), small.camera()
    a = state.anchors
    with torch.no_grad():
        rows = torch.arange(len(a))
        seen = in_view(state.frame.world(a.lattice), a.scaling, a.offsets, camera)
        g, owners, _ = expand(state.exact(rows), state.networks, torch.from_numpy(camera.centre))
    pose = torch.from_numpy(camera.world_to_camera).float()
    local = g.centres @ pose[:3, :3].T + pose[:3, 3]
    x, y = (camera.fx * local[:, k] / local[:, 2] + camera.cx for k in (0, 1))
    inside = (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    assert set(owners[inside].tolist()) <= set(seen.tolist())
