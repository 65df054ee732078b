"""Pictures of the source, and how far pictures of results are from them (encoder only).

Many small pictures say more than a few large ones: from view to view PSNR differs by 5 to 10 dB, from one sampling of
a picture's pixels to another by a few tenths (docs/decisions/0025-quality-everywhere.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from reference_encoder.judge.quality import Quality
from reference_encoder.judge.views import Views
from scarfmt.arrays import F32
from scarfmt.render.camera import Camera
from scarfmt.render.metrics import psnr
from scarfmt.render.projection import Drawable
from scarfmt.render.rasterise import render
from scarfmt.render.several import each_view
from scarfmt.scene.gaussians import GaussianScene

S = TypeVar("S")
View = Callable[[Camera], F32]
"""From a camera to the (height, width, 3) float32 picture."""


def gaussian_view(scene: GaussianScene) -> View:
    """A scene, ready to be drawn."""
    return partial(render, Drawable.of(scene))


@dataclass(frozen=True)
class Judge(Generic[S]):
    """Views of the source, those left out that show nothing of it.

    Attributes:
        view: makes a scene of this sort ready to be drawn.
        seen: of each kind, views and pictures of the source.
        shares: how much each kind counts.
        most_db: what a picture counts for at most.
    """

    view: Callable[[S], View]
    seen: Mapping[str, Sequence[tuple[Camera, F32]]]
    shares: Mapping[str, float]
    most_db: float = math.inf

    @classmethod
    def of(cls, scene: S, view: Callable[[S], View], views: Views, most_db: float = math.inf) -> Judge[S]:
        """With pictures of `scene`, which are drawn here."""
        draw = view(scene)
        pictures = {
            kind: list(zip(cameras, each_view(draw, cameras), strict=True)) for kind, cameras in views.cameras.items()
        }
        shown = {kind: [pair for pair in pairs if pair[1].any()] for kind, pairs in pictures.items()}
        return cls(view, {kind: pairs for kind, pairs in shown.items() if pairs}, views.shares, most_db)

    def thinned(self, some: Callable[[int], slice]) -> Judge[S]:
        """`some` of so many views of each kind."""
        return replace(self, seen={kind: pairs[some(len(pairs))] for kind, pairs in self.seen.items()})

    def quality(self, scene: S) -> Quality:
        """How good pictures of `scene` are."""
        draw = self.view(scene)
        found = {
            kind: np.array([min(decibels, self.most_db) for decibels in _decibels(draw, pairs)])
            for kind, pairs in self.seen.items()
        }
        return Quality(found, self.shares)


def _decibels(draw: View, pairs: Sequence[tuple[Camera, F32]]) -> Iterator[float]:
    """PSNR of what `draw` draws from each camera against the picture beside it, dB."""
    drawn = each_view(draw, [camera for camera, _ in pairs])
    return (psnr(picture, truth) for picture, (_, truth) in zip(drawn, pairs, strict=True))
