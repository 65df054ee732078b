"""How good pictures of results are, by the kind of place they are seen from (encoder only).

Many small pictures say more than a few large ones: from view to view PSNR differs by 5 to 10 dB, from one sampling of
a picture's pixels to another by a few tenths (docs/decisions/0025-quality-everywhere.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np

from reference_encoder.importance.view_sampling import BESIDE, GIVEN, Views
from reference_encoder.options import MAX_QUALITY, MIN_QUALITY, EncodeOptions
from reference_encoder.tuning import (
    GROWTH_A_DB,
    KIND_BELOW_DB,
    LIT,
    LIT_SHARE,
    LOW_BELOW_DB,
    MEAN_ABOVE_DB,
    MOST_ABOVE_DB,
    PREVIEW_LOW_BELOW_DB,
    PREVIEW_LOW_PART,
    TOLERANCE_DB,
)
from scarfmt.arrays import F32, F64
from scarfmt.render.camera import Camera
from scarfmt.render.metrics import psnr
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.scene.gaussians import GaussianScene
from scarfmt.threads import map_threads

S = TypeVar("S")
View = Callable[[Camera], F32]
"""From a camera to the (height, width, 3) float32 picture."""
Pictures = Mapping[str, Sequence[tuple[Camera, F32]]]
"""Views of each kind, and their (height, width, 3) pictures."""

ALIKE_DB = 35.0
"""PSNR from which on people hardly tell a picture from that of the source: an error of 1.8 % of white."""

_PLACES = {"orbit": "from outside", "near": "close to it", GIVEN: "near the cameras", BESIDE: "beside the cameras"}
"""Kinds of views in words for people."""

LOW_PART = 0.05
"""Share of the views that come out worst; the best of these is the 5th percentile."""


def cap_db(asked_db: float) -> float:
    """Maximum PSNR that one picture counts for, dB, at this target.

    Where next to nothing differs, more is no merit; and one picture without any error would make a mean infinite.
    """
    return asked_db + MOST_ABOVE_DB


@dataclass(frozen=True)
class Quality:
    """PSNR of pictures of a result against pictures of the source, from views of several kinds.

    Attributes:
        psnr_db: kind -> (n,) float64 of its views, each at most :func:`cap_db`; kinds that show nothing are left out.
        shares: how much each kind counts, of whatever sum.
    """

    psnr_db: Mapping[str, F64]
    shares: Mapping[str, float]

    def __len__(self) -> int:
        """Views of all kinds."""
        return sum(map(len, self.psnr_db.values()))

    @property
    def mean_db(self) -> float:
        """Over all views, kinds by their shares; infinite where there is none."""
        weights, values = self._weigh()
        return float(weights @ values) if len(values) else math.inf

    @property
    def low_db(self) -> float:
        """5th percentile of all views, kinds by their shares; infinite where there is none."""
        return self._percentile_db(LOW_PART)

    @property
    def rated_db(self) -> float:
        """The mean, less what the 5th percentile lacks of lying :data:`LOW_BELOW_DB` below it, up to
        :data:`MEAN_ABOVE_DB`."""
        if not len(self):
            return math.inf
        return self.mean_db - min(max(0.0, self.mean_db - LOW_BELOW_DB - self.low_db), MEAN_ABOVE_DB)

    @property
    def preview_db(self) -> float:
        """How good a coarse layer looks: the mean, or what its worse places allow of it.

        A mean forgives a hole that is seen from few places (docs/decisions/0062-one-judge.md).
        """
        return min(self.mean_db, self._percentile_db(PREVIEW_LOW_PART) + PREVIEW_LOW_BELOW_DB)

    @property
    def worst_db(self) -> float:
        """PSNR of the worst of all views, dB; infinite if there is no view."""
        return float(self._weigh()[1].min(initial=math.inf))

    @property
    def error_db(self) -> float:
        """Standard error of the mean, dB: other views of the same kinds would have another; 0 of fewer than two views a
        kind."""
        spread = [
            (self.shares[kind] / sum(self.shares[each] for each in self.psnr_db)) ** 2 * found.var(ddof=1) / len(found)
            for kind, found in self.psnr_db.items()
            if len(found) > 1
        ]
        return math.sqrt(sum(spread))

    def by_kind(self) -> dict[str, Quality]:
        """The quality of the views of each kind."""
        return {kind: Quality({kind: values}, {kind: 1.0}) for kind, values in self.psnr_db.items()}

    def verdict(self) -> str:
        """How much a result looks like its source, in one line for people."""
        if not len(self):
            return "not judged: no view shows anything"
        weights, values = self._weigh()
        share = float(weights @ (values >= ALIKE_DB))
        places = "all places tried" if values.min() >= ALIKE_DB else f"{math.floor(100 * share + 1e-9)} % of places"
        worst = min(self.psnr_db, key=lambda kind: float(self.psnr_db[kind].min()))
        return (
            f"looks like the source from {places} ({ALIKE_DB:g} dB or more),"
            f" {self.mean_db:.1f} ± {self.error_db:.1f} dB on average;"
            f" worst {_PLACES.get(worst, worst)}, {self.worst_db:.1f} dB"
        )

    def explain_miss(self, options: EncodeOptions) -> str:
        """How far a result is from what was asked and what to ask for instead, for people; empty where it is near."""
        option, found = ("quality", self.mean_db) if options.worst is None else ("worst", self.low_db)
        lacking = options.asked_db - found
        if lacking <= KIND_BELOW_DB:
            return ""
        more = f"--{option} {min(options.asked_db + lacking, MAX_QUALITY):.0f} aims higher"
        advice = more if options.effort else "--effort 1 comes closer"
        return f"{lacking:.1f} dB below --{option} {options.asked_db:g}: {advice}"

    def shortfalls(self, asked_db: float) -> list[str]:
        """The figures that are far below the target, in one sentence each."""
        said = [
            f"{kind} is {asked_db - found.mean_db:.1f} dB below the target"
            for kind, found in self.by_kind().items()
            if found.mean_db < asked_db - KIND_BELOW_DB
        ]
        lacking = asked_db - LOW_BELOW_DB - self.low_db
        if lacking > TOLERANCE_DB:
            below = f"5 % of the views are at least {asked_db - self.low_db:.1f} dB below the target"
            more = 100 * ((1 + GROWTH_A_DB) ** lacking - 1)
            least = max(MIN_QUALITY, math.floor(asked_db - LOW_BELOW_DB))
            said.append(f"{below}; --worst {least:g} raises them, for about {more:.0f} % more bytes")
        return said

    def figures(self) -> dict[str, Any]:
        """JSON-able: number of views; mean, 5th percentile and worst in dB, two decimals, and the standard error of the
        mean; all but the last of each kind."""
        error = {"error_db": round(self.error_db, 2)} if len(self) else {}
        return {**self._figures(), **error, "kinds": {kind: found._figures() for kind, found in self.by_kind().items()}}

    def _figures(self) -> dict[str, Any]:
        if not len(self):
            return {"views": 0}
        said = {"mean_db": self.mean_db, "p5_db": self.low_db, "worst_db": self.worst_db}
        return {"views": len(self), **{name: round(value, 2) for name, value in said.items()}}

    def _percentile_db(self, part: float) -> float:
        """What that part of all views is no better than, kinds by their shares; infinite where there is none."""
        weights, values = self._weigh()
        if not len(values):
            return math.inf
        order = np.argsort(values)
        reached = np.cumsum(weights[order]) >= part - 1e-9
        return float(values[order][int(np.argmax(reached))])

    def _weigh(self) -> tuple[F64, F64]:
        """(n,) weights that add up to 1, and (n,) dB, of all views."""
        kinds = list(self.psnr_db)
        values = [self.psnr_db[kind] for kind in kinds]
        weights = [np.full(len(self.psnr_db[kind]), self.shares[kind] / len(self.psnr_db[kind])) for kind in kinds]
        joined = np.concatenate([np.zeros(0), *weights])
        return joined / max(float(joined.sum()), 1e-300), np.concatenate([np.zeros(0), *values])


def draw_gaussians(scene: GaussianScene) -> View:
    """A scene, ready to be drawn."""
    return partial(render, Drawable.of(scene))


@dataclass(frozen=True)
class Judge(Generic[S]):
    """Views of the source, those left out that show next to nothing of it.

    Attributes:
        view: makes a scene of this sort ready to be drawn.
        seen: of each kind, views and pictures of the source.
        shares: how much each kind counts.
        most_db: what a picture counts for at most.
    """

    view: Callable[[S], View]
    seen: Pictures
    shares: Mapping[str, float]
    most_db: float = math.inf

    @classmethod
    def of(cls, scene: S, view: Callable[[S], View], views: Views, most_db: float = math.inf) -> Judge[S]:
        """With pictures of `scene`, which are drawn here."""
        draw = view(scene)
        pictures = {
            kind: list(zip(cameras, map_threads(draw, cameras), strict=True)) for kind, cameras in views.views.items()
        }
        # Where no view shows much, those that show anything are all there is.
        for show in (shows_something, np.any):
            shown = {kind: [pair for pair in pairs if show(pair[1])] for kind, pairs in pictures.items()}
            if any(shown.values()):
                break
        return cls(view, {kind: pairs for kind, pairs in shown.items() if pairs}, views.shares, most_db)

    def thin(self, views: int, most_db: float) -> Judge[S]:
        """At least `views` of each kind, evenly taken from more; a picture counts for at most `most_db`."""
        few = {kind: pairs[:: max(1, len(pairs) // views)] for kind, pairs in self.seen.items()}
        return replace(self, seen=few, most_db=most_db)

    def quality(self, scene: S) -> Quality:
        """How good pictures of `scene` are."""
        draw = self.view(scene)
        found = {}
        for kind, pairs in self.seen.items():
            drawn = map_threads(draw, [camera for camera, _ in pairs])
            decibels = (psnr(picture, truth) for picture, (_, truth) in zip(drawn, pairs, strict=True))
            found[kind] = np.array([min(each, self.most_db) for each in decibels])
        return Quality(found, self.shares)


def shows_something(picture: F32) -> bool:
    """Whether enough of a (height, width, 3) picture is not black to tell anything."""
    return float((picture.max(axis=2) > LIT).mean()) >= LIT_SHARE
