"""A small scene in training, for tests of its parts."""

from __future__ import annotations

import numpy as np
import torch

from reference_encoder.training.anchors import SLOTS, AnchorLattice, Anchors, SceneNetworks
from reference_encoder.training.densification import AnchorStatistics
from reference_encoder.training.layers import LayerPlan
from reference_encoder.training.options import LAST_LAYER
from reference_encoder.training.photo_store import View
from reference_encoder.training.quantiser import Quantiser
from reference_encoder.training.rate import Context
from reference_encoder.training.state import State
from reference_encoder.training.vq_features import VqFeatures
from scarfmt.render.camera import Camera

LATENT = 8


def state(count: int = 40, layers: int = 3, vectors: bool = False, seed: int = 0) -> State:
    """`count` anchors in a ball of radius 1, all values drawn at random, every slot open in some layer or none."""
    generator = torch.Generator().manual_seed(seed)
    lattice = torch.unique(torch.randint(0, 200, (count, 3), generator=generator), dim=0)
    n = len(lattice)
    anchors = Anchors(
        lattice,
        torch.randn(n, LATENT, generator=generator),
        -3 + 0.3 * torch.randn(n, 6, generator=generator),
        0.5 * torch.randn(n, SLOTS, 3, generator=generator),
        torch.randint(0, layers + 1, (n, SLOTS), generator=generator),
        torch.zeros(n, dtype=torch.long),
    )
    width = 6 if vectors else 6 + LATENT
    quantiser = Quantiser(4, LATENT, 2, 8, seed=seed)
    made = State(
        frame=AnchorLattice(torch.full((3,), -1.0, dtype=torch.float64), 0.01),
        anchors=anchors,
        networks=SceneNetworks(LATENT, seed),
        context=Context(width),
        log_widths=torch.zeros(width),
        log_offset_widths=torch.zeros(3),
        statistics=AnchorStatistics.of(n),
        plan=LayerPlan.of(layers, LAST_LAYER),
        generator=generator,
        extent=2.0,
        exposures=torch.zeros(1, 2, 3),
        vectors=VqFeatures(quantiser, (1, 1, 2)[:layers]) if vectors else None,
    )
    made.start_widths()
    return made


def view(of: Camera, photo: torch.Tensor) -> View:
    """A camera that sees (H, W, 3) uint8."""
    return View(of, lambda: photo)


def camera(width: int = 48, height: int = 40) -> Camera:
    """Four units in front of the ball."""
    pose = np.eye(4)
    pose[2, 3] = 4.0
    return Camera(width, height, 50.0, 50.0, width / 2, height / 2, pose)
