"""The weights of the anchors of a file from some eyes, and the distance to their final values (encoder; needs
torch)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reference_encoder.measure.anchor_sensitivity import feature_metric, seen_slots
from reference_encoder.streaming.errors import ABSENCE, LayerErrors, State, states
from reference_encoder.streaming.eyes import Eye
from reference_encoder.tuning import SIZE_SHARE
from scarfmt.arrays import F64, Bools
from scarfmt.coding.writer import QuantisedScene
from scarfmt.container.schema import Stream
from scarfmt.scene.gaussians import AnchorModel


class AnchorWeights:
    """The weights of N anchors of K slots, seen from V eyes.

    Args:
        model: the anchors.
        places: the eyes.
        seed: of the anchors that features are weighed by.

    Attributes:
        shape, colour: (V, N) float64 mean squared error of pictures from there, per squared unit.
        slots: (N, K) float64 of each slot, all eyes together.
        inverse_variance: (N, K) float64 one over the variance of a slot's middle axis, mean.
        metric: (D, D) which errors of features matter.
    """

    def __init__(self, model: AnchorModel, places: Sequence[Eye], seed: int) -> None:
        count, slots = len(model), model.slots
        self.shape, self.colour = (np.zeros((len(places), count)) for _ in range(2))
        self.slots, colours, inverse, hits = (np.zeros((count, slots)) for _ in range(4))
        for number, eye in enumerate(places):
            for seen in seen_slots(model, eye.cameras):
                at = seen.anchor, seen.slot
                self.shape[number] += np.bincount(seen.anchor, seen.shape, count)
                self.colour[number] += np.bincount(seen.anchor, seen.colour, count)
                self.slots[at] += seen.shape
                colours[at] += seen.colour
                inverse[at] += seen.inverse_variance
                hits[at] += 1
        self.inverse_variance = inverse / np.maximum(hits, 1)
        cameras = [camera for eye in places for camera in eye.cameras]
        self.metric = feature_metric(model, cameras, self.slots, colours, seed)


def anchor_errors(scene: QuantisedScene, model: AnchorModel, weights: AnchorWeights) -> list[LayerErrors]:
    """Errors after no layer, after layer 1, and so on to the last but one, as for Gaussians.

    Args:
        scene: of the anchor profile.
        model: its anchors, in file order.
        weights: of them.
    """
    count = len(model)
    on = np.concatenate([content.slot_layers for content in scene.contents])
    share = weights.slots / np.maximum(weights.slots.sum(axis=1, keepdims=True), 1e-300)
    moved = model.offsets.astype(np.float64) * np.exp(model.log_scaling[:, None, :3].astype(np.float64))
    moving = np.einsum("nk,nkc->nc", share * weights.inverse_variance, moved**2)
    scale = np.concatenate([moving, np.full((count, 3), SIZE_SHARE)], axis=1)
    *before, last = states(scene)
    out = [LayerErrors(np.full(count, ABSENCE), np.zeros(count))]
    for state in before:
        dark: Bools = (on == 0) | (on > state.layer)
        missing = (share * (dark & (on > 0))).sum(axis=1)
        out.append(_left(state, last, scale, missing, weights.metric))
    return out


def _left(state: State, last: State, scale: F64, missing: F64, metric: F64) -> LayerErrors:
    there = state.there
    shape, colour = np.full(len(there), ABSENCE), np.zeros(len(there))
    features = state.outputs.astype(np.float64) - last.outputs[there]
    feature = np.einsum("nd,de,ne->n", features, metric, features, optimize=True)
    scaling = (state.values[Stream.SCALE].astype(np.float64) - last.values[Stream.SCALE][there]) ** 2
    shape[there] = np.minimum(ABSENCE * missing[there] + (scaling * scale[there]).sum(axis=1) + feature, ABSENCE)
    colour[there] = feature
    return LayerErrors(shape, colour)
