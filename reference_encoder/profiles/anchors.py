"""The anchor profile: a Scaffold-GS style model (encoder side; paper §3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from reference_decoder.reconstruct import NETWORKS
from reference_encoder.importance.anchor_sensitivity import AnchorSensitivity, draw_anchors, measure_anchors
from reference_encoder.importance.view_sampling import ViewSet, judging_views, sample_views
from reference_encoder.judge.quality import Judge, cap_db
from reference_encoder.judge.reconstruct import reconstruct_anchors
from reference_encoder.options import EncodeOptions
from reference_encoder.rdo.allocation import Allocation, assemble_scene
from reference_encoder.rdo.classes import Classes, classify
from reference_encoder.rdo.curves import best_width, position_bits, predict_lambda
from reference_encoder.rdo.latent import fit_latent
from reference_encoder.rdo.lattice import place
from reference_encoder.rdo.rdo_input import RdoInput
from reference_encoder.rdo.rounding import round_values
from reference_encoder.streaming_block import place_anchors
from reference_encoder.tuning import (
    ANCHOR_BASE_SHARE,
    ANCHOR_BITS,
    ANCHOR_COARSEST,
    ANCHOR_LAMBDA_DB,
    ANCHOR_VIEWS,
    COARSEST_LATENT,
    MLP_BITS,
    MOST_ANCHOR_CLASSES,
    SIZE_SHARE,
    SLOT_ABSENCE,
    SLOT_BITS,
)
from scarfmt.arrays import F64, I64, Bools
from scarfmt.blocks.mlp import Linear, QuantisedMlp
from scarfmt.coding.writer import QuantisedScene, Report, silent
from scarfmt.container import schema
from scarfmt.container.schema import Stream
from scarfmt.errors import InvalidInput
from scarfmt.render.viewpoints import resolve_frame
from scarfmt.scene.gaussians import AnchorModel, Mlp
from scarfmt.scene.model import Channel, LayerRow, SceneModel


@dataclass(frozen=True)
class AnchorProfile:
    """An anchor model, and what is known of it whatever the quality; a :class:`Profile`.

    Attributes:
        model: the source.
        sensitivity: what errors in it show.
        options, report: of the encoder.
    """

    previews = False
    reconstruct = staticmethod(reconstruct_anchors)

    model: AnchorModel
    sensitivity: AnchorSensitivity
    options: EncodeOptions
    report: Report

    @classmethod
    def measure(cls, model: AnchorModel, options: EncodeOptions, report: Report = silent) -> AnchorProfile:
        """Measure a model without NaN or infinity, from the views that matter.

        Raises:
            InvalidInput: ``input-anchors`` when its networks are missing; ``input-options`` at effort 0.
        """
        if options.effort == 0:
            raise InvalidInput("input-options", "anchor models need views: give effort 1 or 2", field="effort")
        if set(model.mlps) != set(NETWORKS):
            raise InvalidInput("input-anchors", f"networks {sorted(model.mlps)}: need opacity, cov and color")
        # As for a scene with a Gaussian on every anchor, but fewer.
        views = sample_views(place_anchors(model), options).thin(ANCHOR_VIEWS)
        options = replace(options, frame=views.up.up)
        seen = measure_anchors(model, views, options.seed, lambda part: report("visibility", part))
        return cls(model, seen, options, report)

    def judge(self, view_set: ViewSet) -> Judge[AnchorModel]:
        """Pictures of the source from views of a set, drawn now."""
        shell, drawn = place_anchors(self.model), len(self.model) * self.model.slots
        views = judging_views(shell, self.options, resolve_frame(shell, self.options.frame), view_set, drawn)
        return Judge.of(self.model, draw_anchors, views, cap_db(self.options.asked_db))

    def prepare(self, quality: float) -> RdoInput:
        """What is to be decided at the lambda predicted to give `quality` dB.

        Raises:
            InvalidInput: ``input-anchors`` when no feature is seen.
        """
        kept = self._keep(predict_lambda(quality, len(self.model), ANCHOR_LAMBDA_DB))
        seen, model = kept.seen, kept.model
        feature = (seen.shape + seen.colour).sum(axis=1)
        latent = fit_latent(model.features, feature, kept.lambda_ * len(model), seen.metric)
        if latent is None:
            raise InvalidInput("input-anchors", "no feature of this model is visible from the given cameras")
        weight = (seen.shape * seen.inverse_variance).sum(axis=1)
        placement = place(model.anchors, best_width(weight, kept.lambda_), self.options.tile_anchors)
        return RdoInput(
            profile=schema.Profile.ANCHOR,
            slots=model.slots,
            sh_degree=0,
            source_count=len(self.model),
            positions=model.anchors,
            placement=placement,
            values={
                Stream.POSITION_RESIDUAL: placement.residual,
                Stream.SCALE: model.log_scaling.astype(np.float64),
                Stream.LATENT: latent.values,
            },
            weights={
                Stream.POSITION_RESIDUAL: np.repeat((weight * placement.cell**2)[:, None], 3, axis=1),
                Stream.SCALE: kept.scale_weight(),
                Stream.LATENT: latent.weight[:, None],
            },
            coarsest={**ANCHOR_COARSEST, Stream.LATENT: (COARSEST_LATENT,) * latent.values.shape[1]},
            latent=latent,
            classes=kept.presence(),
            lambda_=kept.lambda_,
            base_share=ANCHOR_BASE_SHARE,
        )

    def _keep(self, lambda_: float) -> _Kept:
        """The anchors and slots that are worth sending."""
        seen = self.sensitivity
        slots = seen.shape * SLOT_ABSENCE > lambda_ * SLOT_BITS
        importance = (seen.shape * slots).sum(axis=1) * SLOT_ABSENCE
        classes, count = classify(importance, lambda_, ANCHOR_BITS, MOST_ANCHOR_CLASSES)
        kept = np.flatnonzero(classes >= 0)
        return _Kept(
            model=_take(self.model, kept),
            seen=seen.take(kept),
            slots=slots[kept],
            classes=classes[kept],
            count=count,
            importance=importance[kept],
            lambda_=lambda_,
        )

    def quantise(self, problem: RdoInput, allocation: Allocation) -> QuantisedScene:
        """All integers of the file of an allocation, offsets and slots now decided too."""
        kept = self._keep(problem.lambda_)
        model, offsets = kept.with_offsets(allocation.model)
        slot_layers = kept.slot_layers(model, allocation.lambdas)
        integers = {**allocation.integers, Stream.OFFSETS: (offsets * (slot_layers > 0)[:, :, None]).astype(np.int32)}
        mlps = tuple(_quantise_mlp(self.model.mlps[name]) for name in NETWORKS)
        allocation = replace(allocation, model=model, integers=integers)
        return assemble_scene(problem, allocation, self.options.metadata, mlps, slot_layers)


@dataclass(frozen=True, kw_only=True)
class _Kept:
    """N anchors with K slots, after the invisible is removed.

    Attributes:
        model, seen: the anchors, and what errors in them show.
        slots: (N, K) whether a slot is worth sending.
        classes: (N,) class of each anchor.
        count: how many classes.
        importance: (N,) squared picture error of leaving an anchor out.
        lambda_: squared picture error per bit.
    """

    model: AnchorModel
    seen: AnchorSensitivity
    slots: Bools
    classes: I64
    count: int
    importance: F64
    lambda_: float

    def presence(self) -> Classes:
        """The classes, and what it costs an anchor to be there with the slots that pay."""
        fixed = position_bits(self.classes, self.count)
        gain = self.seen.shape * SLOT_ABSENCE * self.slots

        def presence_bits(lambda_: float) -> F64:
            shown = (gain > lambda_ * SLOT_BITS).sum(axis=1)
            return fixed + SLOT_BITS * np.bincount(self.classes, shown, self.count)

        return Classes(
            of=self.classes,
            count=self.count,
            importance=self.importance,
            coverage_rank=None,
            presence_bits=presence_bits,
        )

    def scale_weight(self) -> F64:
        """(N, 6) squared picture error per squared unit of each log scaling: three move slots, three size them."""
        seen, model = self.seen, self.model
        moved = model.offsets.astype(np.float64) * np.exp(model.log_scaling[:, None, :3].astype(np.float64))
        moving = np.einsum("nk,nkc->nc", seen.shape * seen.inverse_variance, moved**2)
        sizing = np.repeat(SIZE_SHARE * seen.shape.sum(axis=1)[:, None], 3, axis=1)
        return np.concatenate([moving, sizing], axis=1)

    def with_offsets(self, scene: SceneModel) -> tuple[SceneModel, I64]:
        """The model with the offsets channel added, and all (N, K, 3) quantised offsets.

        One step a component serves all slots: the one where the last bit of precision pays on average.
        """
        offsets = self.model.offsets
        reach = np.exp(2 * self.model.log_scaling[:, :3].astype(np.float64))
        weight = (self.seen.shape * self.seen.inverse_variance)[:, :, None] * reach[:, None, :]
        active = np.broadcast_to(self.slots[:, :, None], weight.shape)
        total = np.maximum((weight * active).sum(axis=(0, 1)), 1e-300)
        largest = float(np.abs(offsets).max(initial=1e-6))
        step = np.clip(np.sqrt(6 * self.lambda_ / np.log(2) * self.slots.sum() / total), largest * 1e-6, largest)
        step = step.astype(np.float32).astype(np.float64)
        anchor, slot = np.nonzero(self.slots)
        chosen = np.zeros(offsets.shape, np.int64)
        chosen[anchor, slot] = round_values(
            offsets[anchor, slot] / step, weight[anchor, slot] * step**2, self.classes[anchor], self.lambda_
        )
        channel = Channel(Stream.OFFSETS, tuple(float(s) for s in step))
        rows = tuple(LayerRow(row.stages, tuple((*steps, 1) for steps in row.steps)) for row in scene.layers)
        return SceneModel(scene.profile, scene.slots, (*scene.channels, channel), rows), chosen

    def slot_layers(self, scene: SceneModel, lambdas: list[float]) -> I64:
        """(N, K) layer that turns each slot on, 0 for never: the first in which it pays, once its anchor is there."""
        appears = 1 + np.searchsorted([row.class_count for row in scene.layers], self.classes, side="right")
        gain = self.seen.shape * SLOT_ABSENCE
        pays = np.stack([gain > lambda_ * SLOT_BITS for lambda_ in lambdas])
        layers = np.maximum(1 + pays.argmax(axis=0), appears[:, None])
        return np.where(self.slots & pays.any(axis=0), np.minimum(layers, len(lambdas)), 0)


def _take(model: AnchorModel, index: I64) -> AnchorModel:
    return AnchorModel(
        model.anchors[index], model.features[index], model.offsets[index], model.log_scaling[index], model.mlps
    )


def _quantise_mlp(mlp: Mlp) -> QuantisedMlp:
    layers = zip(mlp.weights, mlp.biases, strict=True)
    return QuantisedMlp(tuple(Linear.quantise(weights, biases, bits=MLP_BITS) for weights, biases in layers))
