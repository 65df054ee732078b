"""The anchor profile: a Scaffold-GS style model (encoder side; paper §3)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from reference_encoder.decide.allocate import classify
from reference_encoder.decide.assemble import Quantised, assembled
from reference_encoder.decide.decision import Decision
from reference_encoder.decide.lagrangian import best_width, lambda_for
from reference_encoder.decide.lattice import place
from reference_encoder.decide.plans import position_bits
from reference_encoder.decide.problem import Budget, Channels, Classes, Geometry, Problem
from reference_encoder.decide.rdo import choose_values
from reference_encoder.judge.finished import finished_anchors
from reference_encoder.judge.judge import Judge
from reference_encoder.judge.quality import most_db
from reference_encoder.judge.views import Sight, judged_views
from reference_encoder.latent.fit import FittedLatent, Wanted, fit_latent
from reference_encoder.measure.anchor_sensitivity import AnchorSensitivity, anchor_view, measure_anchors
from reference_encoder.measure.survey import Survey, survey
from reference_encoder.options import EncodeOptions
from reference_encoder.tuning import (
    ANCHOR_BASE_SHARE,
    ANCHOR_BITS,
    ANCHOR_COARSEST,
    ANCHOR_EXTRA_STAGES,
    ANCHOR_LAMBDA_DB,
    ANCHOR_VIEWS,
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
from scarfmt.render.upright import resolved
from scarfmt.scene.gaussians import AnchorModel, GaussianScene, Mlp
from scarfmt.scene.model import Channel, ContextRule, LayerRow, SceneModel

_NETWORKS = ("opacity", "cov", "color")


@dataclass(frozen=True)
class AnchorProfile:
    """An anchor model, and what is known of it whatever the quality; a :class:`Profile`.

    Attributes:
        model: the source.
        sensitivity: what errors in it show.
        options, report: of the encoder.
    """

    model: AnchorModel
    sensitivity: AnchorSensitivity
    options: EncodeOptions
    report: Report

    @classmethod
    def measured(cls, model: AnchorModel, options: EncodeOptions, report: Report = silent) -> AnchorProfile:
        """A model without NaN or infinity, looked at from the views that matter.

        Raises:
            InvalidInput: ``input-anchors`` when its networks are missing.
        """
        if set(model.mlps) != set(_NETWORKS):
            raise InvalidInput("input-anchors", f"networks {sorted(model.mlps)}: need opacity, cov and color")
        seen = measure_anchors(model, _survey(model, options), options.seed, lambda f: report("visibility", f))
        return cls(model, seen, options, report)

    @property
    def source_count(self) -> int:
        """Anchors of the source."""
        return len(self.model)

    def judge(self, sight: Sight) -> Judge[AnchorModel]:
        """Pictures of the source from views of a set, drawn now."""
        shell, drawn = _shell(self.model), len(self.model) * self.model.slots
        views = judged_views(shell, self.options, resolved(shell, self.options.frame), sight, drawn)
        return Judge.of(self.model, anchor_view, views, most_db(self.options.asked_db))

    @property
    def shows_layers(self) -> bool:
        """Whether layers can be drawn."""
        return False

    @property
    def looks(self) -> None:
        """Nothing: layers are as predicted."""
        return

    def problem(self, quality: float) -> Problem:
        """The problem of encoding at the lambda predicted to give `quality` dB, with its latent fitted.

        Raises:
            InvalidInput: ``input-anchors`` when no feature is seen.
        """
        kept = self._kept(lambda_for(quality, len(self.model), ANCHOR_LAMBDA_DB))
        seen, model = kept.seen, kept.model
        weight = (seen.shape * seen.inverse_variance).sum(axis=1)
        placement = place(model.anchors, best_width(weight, kept.lambda_), self.options.tile_anchors)
        values = {Stream.POSITION_RESIDUAL: placement.residual, Stream.SCALE: model.log_scaling.astype(np.float64)}
        weights = {
            Stream.POSITION_RESIDUAL: np.repeat((weight * placement.cell**2)[:, None], 3, axis=1),
            Stream.SCALE: kept.scale_weight(),
        }
        geometry = Geometry(
            profile=schema.Profile.ANCHOR,
            slots=model.slots,
            sh_degree=0,
            source_count=len(self.model),
            positions=model.anchors,
            placement=placement,
        )
        return Problem(
            geometry=geometry,
            channels=Channels(values=values, weights=weights, coarsest=ANCHOR_COARSEST),
            fitted=self._fitted(kept),
            classes=kept.presence(),
            budget=Budget(lambda_=kept.lambda_, lost=kept.lost, base_share=ANCHOR_BASE_SHARE),
        )

    def _kept(self, lambda_: float) -> _Kept:
        """The anchors and slots that are worth sending."""
        seen = self.sensitivity
        slots = seen.shape * SLOT_ABSENCE > lambda_ * SLOT_BITS
        importance = (seen.shape * slots).sum(axis=1) * SLOT_ABSENCE
        classes, count = classify(importance, lambda_, ANCHOR_BITS, MOST_ANCHOR_CLASSES)
        kept = np.flatnonzero(classes >= 0)
        return _Kept(
            model=_taken(self.model, kept),
            seen=seen.take(kept),
            slots=slots[kept],
            classes=classes[kept],
            count=count,
            importance=importance[kept],
            lambda_=lambda_,
            lost=float((seen.shape.sum() - (seen.shape * slots)[kept].sum()) * SLOT_ABSENCE),
        )

    def _fitted(self, kept: _Kept) -> FittedLatent:
        wanted = Wanted(
            vectors=kept.model.features,
            weight=kept.seen.feature,
            classes=kept.classes,
            lambda_=kept.lambda_,
            metric=kept.seen.metric,
            extra_stages=ANCHOR_EXTRA_STAGES,
        )
        fitted = fit_latent(wanted, self.options, self.report)
        if fitted is None:
            raise InvalidInput("input-anchors", "no feature of this model is visible from the given cameras")
        return fitted

    def finish(self, problem: Problem, decision: Decision) -> Quantised:
        """All integers of the file that `decision` says, offsets and slots now decided too."""
        kept = self._kept(problem.budget.lambda_)
        model, offsets = kept.with_offsets(decision.model)
        slot_layers = kept.slot_layers(model, decision.lambdas)
        finals = {**decision.finals, Stream.OFFSETS: offsets * (slot_layers > 0)[:, :, None]}
        mlps = tuple(_quantised(self.model.mlps[name]) for name in _NETWORKS)
        decided = replace(decision, model=model, finals=finals)
        return assembled(problem, decided, self.options.metadata, mlps, slot_layers)

    def finished(self, scene: QuantisedScene) -> AnchorModel:
        """The scene that a decoder makes of the last layer of a file."""
        return finished_anchors(scene)


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
        lost: squared picture error of what is gone.
    """

    model: AnchorModel
    seen: AnchorSensitivity
    slots: Bools
    classes: I64
    count: int
    importance: F64
    lambda_: float
    lost: float

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
            standing=np.zeros(len(self.classes)),  # layers of anchors are of whole classes
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
        anchor, slot = np.nonzero(self.slots)
        chosen = np.zeros(offsets.shape, np.int64)
        chosen[anchor, slot] = choose_values(
            offsets[anchor, slot] / step, weight[anchor, slot] * step**2, self.classes[anchor], self.lambda_
        )
        channel = Channel(Stream.OFFSETS, tuple(float(s) for s in step), (ContextRule(),) * 3)
        rows = tuple(LayerRow(row.stages, tuple((*steps, 1) for steps in row.steps)) for row in scene.layers)
        return SceneModel(scene.profile, scene.slots, (*scene.channels, channel), rows), chosen

    def slot_layers(self, scene: SceneModel, lambdas: list[float]) -> I64:
        """(N, K) layer that turns each slot on, 0 for never: the first in which it pays, once its anchor is there."""
        appears = 1 + np.searchsorted([row.class_count for row in scene.layers], self.classes, side="right")
        gain = self.seen.shape * SLOT_ABSENCE
        pays = np.stack([gain > lambda_ * SLOT_BITS for lambda_ in lambdas])
        layers = np.maximum(1 + pays.argmax(axis=0), appears[:, None])
        return np.where(self.slots & pays.any(axis=0), np.minimum(layers, len(lambdas)), 0)


def _survey(model: AnchorModel, options: EncodeOptions) -> Survey:
    """The views to measure from, as for a scene with a Gaussian on every anchor, but fewer."""
    return survey(_shell(model), options).thinned(ANCHOR_VIEWS)


def _shell(model: AnchorModel) -> GaussianScene:
    """A Gaussian on every anchor, of which only the place counts."""
    n = len(model)
    return GaussianScene(
        model.anchors,
        np.zeros((n, 3), np.float32),
        np.zeros((n, 4), np.float32),
        np.zeros(n, np.float32),
        np.zeros((n, 1, 3), np.float32),
    )


def _taken(model: AnchorModel, index: I64) -> AnchorModel:
    return AnchorModel(
        model.anchors[index], model.features[index], model.offsets[index], model.log_scaling[index], model.mlps
    )


def _quantised(mlp: Mlp) -> QuantisedMlp:
    layers = zip(mlp.weights, mlp.biases, strict=True)
    return QuantisedMlp(tuple(Linear.quantised(weights, biases, bits=MLP_BITS) for weights, biases in layers))
