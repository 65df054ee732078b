"""The loop: which photo, which layer, when anchors grow, when values are rounded (paper §3; Scaffold-GS §3)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from reference_encoder.training.anchors import ATTRIBUTES
from reference_encoder.training.densification import GRADIENT_LIMIT, densify
from reference_encoder.training.export import fit_table_limits, quantise_scene
from reference_encoder.training.index_entropy import JointIndexModel
from reference_encoder.training.iterate import iterate
from reference_encoder.training.optimizer import WeightAverage
from reference_encoder.training.photo_store import View
from reference_encoder.training.presets import Curriculum, Moment, moment
from reference_encoder.training.rate_controller import RateController
from reference_encoder.training.slot_importance import first_layers, measure_importance
from reference_encoder.training.state import State
from scarfmt.coding.writer import QuantisedScene

_GROW_EVERY = 100
_LEAST_DRAWN = 0.4
"""Least share of the iterations between two rounds of growth in which a slot must be drawn to be judged."""
_LEAST_SEEN = 0.8
_DECISIONS, _DECIDE_EVERY = 20, 100
"""Decisions of masks in a run, and the least iterations between two."""
_LOOKS, _FIRST_LOOKS = 48, 144
"""Photos that each decision and that the first looks at."""
_LEARNT_A_LOOK = 4
"""Iterations of a run for each photo that a decision looks at, at least."""
_LEFT = 0.001
"""Least share of its bits that the last layer has left after all decisions. Each takes its part of that, so that what
stays has the time to do what others did, and none closes what is missed for good."""
_LEFT_A_ROUND = 0.7
"""The same for each time that all photos have been learnt from since the decision before: what is closed before its
photos were seen was never judged."""
_YOUNG = 400
"""Iterations in which an anchor may show what it is worth."""
_STEER_EVERY = 100
"""Iterations between two corrections of prices once masks are settled."""
_LOOK_EVERY = 25
"""Iterations between two looks of anchors at their neighbours."""
_REFRESH_EVERY, _INDEX_EVERY = 1000, 5
"""Iterations between two looks at the indices of the scene, and between two steps of what codes them."""
_LARGEST_AFTER_PRUNING = 0.05
SMALL_UNTIL = 0.7
"""Fraction of the run until which photos are learnt at half their size, a quarter of the pixels, if they are large."""


@dataclass
class Trainer:
    """A run.

    Attributes:
        state: what is learnt.
        rate_controller: prices of bits.
        views, small: cameras and photos to learn from, whole and at half their size, if that is enough to see.
        curriculum: when what happens.
        background: (3,) colour behind everything.
        camera_jitter: see `iterate`.
        iteration: how many are done.
        order: photos still to come before all are drawn again.
        joint: what learns to code indices along with the scene, if codewords carry features; on the processor.
        index_bits: L_feat of its last step, bits an anchor.
        averaging: of what is learnt.
        decided: `Moment.masks` of the last decision; `decided_at`: the iteration after which it was taken.
        noisy, indexed: whether noise, learning to code indices have begun.
    """

    state: State
    rate_controller: RateController
    views: Sequence[View]
    small: Sequence[View]
    curriculum: Curriculum
    background: Tensor
    camera_jitter: float = 0.0
    iteration: int = 0
    order: list[int] = field(default_factory=list)
    joint: JointIndexModel | None = None
    index_bits: float = 0.0
    averaging: WeightAverage = field(default_factory=WeightAverage)
    decided: float = 0.0
    decided_at: int = 0
    noisy: bool = False
    indexed: bool = False

    def step(self, done: float) -> float:
        """One iteration, when the fraction `done` of the run is behind; its loss without rate."""
        now = moment(self.curriculum, done)
        self._begin(now)
        layer = self._draw_layer(now)
        price = 0.0 if now.fine_tunes else now.rate * self.rate_controller.a_bit(layer)
        views = self.small if done < SMALL_UNTIL else self.views
        view = views[self._next_photo()]
        loss, bits = iterate(self.state, view, now, layer, price, self.camera_jitter, self.background)
        if bits is not None:
            self.rate_controller.record_estimate(layer, bits)
        self.state.descent.step(done, lambda name: _share(name, now))
        if now.averages:
            self.averaging.update(list_averaged(self.state.descent.parameters))
        if self.state.vectors is not None:
            self.state.vectors.step()
        if self.joint is not None and now.entropy:
            self._learn_indices()
        self.iteration += 1
        self._restructure(now)
        return loss

    def _draw_layer(self, now: Moment) -> int:
        draws = self.state.plan.draws
        if not now.draws_layer or len(draws) == 1:
            return len(draws) - 1
        return int(torch.multinomial(torch.tensor(draws), 1, generator=self.state.generator))

    def phase(self, done: float) -> str:
        """The current phase of learning, in a few words."""
        now = moment(self.curriculum, done)
        if now.fine_tunes:
            return "networks fitted to the file's integers"
        if now.rounded:
            return "rounded values"
        if now.draws_layer:
            return "layers and rate"
        return "rate" if now.rate > 0 else "anchors"

    def _begin(self, now: Moment) -> None:
        """Do what happens once, at the start of a phase."""
        if not now.averages:
            self.averaging.apply(list_averaged(self.state.descent.parameters))
        if now.noisy or now.rounded:
            self._start_values()
        if now.quantises:
            self._start_vectors()
        vectors = self.state.vectors
        if now.hard and vectors is not None and not vectors.opened:
            vectors.open()

    def finish(self) -> None:
        """Make sure that there is a file to write, however early a run ends."""
        self.averaging.apply(list_averaged(self.state.descent.parameters))
        self._start_values()
        self._start_vectors()
        if not self.decided:
            self._decide_masks(1.0, 1 / _DECISIONS)

    def _start_values(self) -> None:
        if not self.noisy:
            self.noisy = True
            self.state.start_widths()

    def _start_vectors(self) -> None:
        vectors = self.state.vectors
        if vectors is not None and not vectors.begun:
            weight = self.state.statistics.weight.sum(dim=1)
            vectors.begin(self.state.anchors.latent.detach(), weight)

    def quantise(self, notes: Mapping[str, Any] | None = None) -> QuantisedScene:
        """All integers of the file as they would be now; cells that no table could serve are wider from now on.

        Args:
            notes: about the training, for the file's METADATA.
        """
        fit_table_limits(self.state)
        training = {"iterations": self.iteration, **(notes or {})}
        return quantise_scene(self.state, {"training": training}, len(self.state.anchors))

    def _learn_indices(self) -> None:
        assert self.joint is not None
        if not self.indexed or self.iteration % _REFRESH_EVERY == 0:
            self.indexed = True
            self.joint.refresh(self.quantise())
        if self.iteration % _INDEX_EVERY == 0:
            self.index_bits = self.joint.step()

    def _restructure(self, now: Moment) -> None:
        if now.grows and self.iteration % _GROW_EVERY == 0:
            self._grow()
        if self._decision_due(now):
            self._decide_masks(now.rate, now.masks)
        elif now.rate > 0 and not now.decides and not now.fine_tunes and self.iteration % _STEER_EVERY == 0:
            self.rate_controller.adjust()
        if now.rate > 0 and self.iteration % _LOOK_EVERY == 0:
            self.state.update_neighbours()

    def checkpoint(self) -> dict[str, Any]:
        """All that a run needs to go on, for a checkpoint."""
        return {
            "state": self.state.checkpoint(),
            "prices": {name: getattr(self.rate_controller, name) for name in ("price", "estimate", "real")},
            "iteration": self.iteration,
            "order": self.order,
            "decided": [self.decided, self.decided_at],
            "noisy": self.noisy,
            "indexed": self.indexed,
            "joint": None if self.joint is None else self.joint.state(),
            "averages": self.averaging.state(),
        }

    def resume(self, saved: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.state.resume(saved["state"])
        for name, values in saved["prices"].items():
            setattr(self.rate_controller, name, list(values))
        self.iteration, self.order = saved["iteration"], list(saved["order"])
        self.decided, self.decided_at = saved["decided"]
        self.noisy, self.indexed = saved["noisy"], saved["indexed"]
        if self.joint is not None:
            self.joint.restore(saved["joint"])
        self.averaging.restore(saved["averages"], self.state.device)

    def _decision_due(self, now: Moment) -> bool:
        since = self.iteration - self.decided_at
        return now.decides and now.masks - self.decided >= 1 / _DECISIONS and since >= _DECIDE_EVERY

    def _decide_masks(self, weight: float, masks: float) -> None:
        """Decide which slots each layer shows from now on. Slots of new anchors stay until they have had time to
        learn.

        Args:
            weight: how much rate counts already, 0..1.
            masks: how much of the time for decisions is over.
        """
        state = self.state
        # A look takes as long as an iteration: a run that is cut short does not look longer than it learnt.
        most = _LOOKS if self.decided else _FIRST_LOOKS
        count = min(most, len(self.small), max(self.iteration // _LEARNT_A_LOOK, 1))
        rounds = (self.iteration - self.decided_at) / len(self.views)
        keeps = max(_LEFT ** (masks - self.decided), _LEFT_A_ROUND**rounds)
        self.decided, self.decided_at = masks, self.iteration
        # Along the path of the camera, others each time.
        turn = round(_DECISIONS * masks)
        chosen = [self.small[(turn + place * len(self.small) // count) % len(self.small)] for place in range(count)]
        importance = measure_importance(state, chosen, self.background)
        first = state.anchors.first
        born = state.anchors.born
        recent = (born > 0) & (born > self.iteration - _YOUNG)
        allowed = first < state.plan.count
        prices = self.rate_controller.mask_prices(importance, allowed, weight, keeps)
        decided = first_layers(importance, prices, allowed)
        state.anchors.first = torch.where(recent[:, None], first, decided)
        self._keep((state.anchors.first < state.plan.count).any(dim=1))

    def _next_photo(self) -> int:
        if not self.order:
            self.order = torch.randperm(len(self.views), generator=self.state.generator).tolist()
        return self.order.pop()

    @torch.no_grad()
    def _grow(self) -> None:
        state = self.state
        a = state.anchors
        centres = a.lattice[:, None].double() + (a.offsets * torch.exp(a.scaling[:, None, :3])).double() / (
            state.frame.voxel
        )
        growth = densify(
            a.lattice, centres, state.statistics, GRADIENT_LIMIT, int(_GROW_EVERY * _LEAST_DRAWN), state.generator
        )
        if len(growth.lattice):
            state.grow(growth, self.iteration)
        unseen = state.statistics.unseen(int(_GROW_EVERY * _LEAST_SEEN))
        self._keep(~unseen)
        state.anchors.scaling[:, 3:].clamp_(max=math.log(_LARGEST_AFTER_PRUNING * state.extent))

    def _keep(self, wanted: Tensor) -> None:
        if not bool(wanted.all()):
            rows = wanted.nonzero()[:, 0]
            none = rows[:0]
            self.state.rearrange(rows, self.state.anchors.select(none))


def list_averaged(learnt: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Parameters whose mean is taken, by name: values of anchors and the networks of the scene."""
    return {name: each for name, each in learnt.items() if name in ATTRIBUTES or name.startswith("networks.")}


def _share(name: str, now: Moment) -> float:
    """The share of the learning rate that a parameter keeps, by what is settled already."""
    if now.rounded and name in ("log_widths", "log_offset_widths"):
        return 0.0
    if now.fine_tunes and name in ATTRIBUTES:
        return 0.0
    return 1.0
