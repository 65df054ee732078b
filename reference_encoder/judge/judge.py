"""Pictures of the source, and how far pictures of results are from them (encoder only).

Many small pictures say more than a few large ones: from view to view PSNR differs by 5 to 10 dB, from one sampling of
a picture's pixels to another by a few tenths (docs/decisions/0025-quality-everywhere.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from reference_encoder.judge.quality import Quality
from scarfmt.arrays import F32
from scarfmt.render.camera import Camera
from scarfmt.render.metrics import psnr

S = TypeVar("S")


@dataclass(frozen=True)
class Judge(Generic[S]):
    """Views of the source, those left out that show nothing of it.

    Attributes:
        draw: how scenes of this sort are drawn.
        views: kind and camera of each view.
        pictures: (height, width, 3) float32 of the source, one a view.
        most_db: what a picture counts for at most.
    """

    draw: Callable[[S, Camera], F32]
    views: Sequence[tuple[str, Camera]]
    pictures: Sequence[F32]
    most_db: float = math.inf

    @classmethod
    def of(
        cls,
        scene: S,
        draw: Callable[[S, Camera], F32],
        views: Mapping[str, Sequence[Camera]],
        most_db: float = math.inf,
    ) -> Judge[S]:
        """With pictures of `scene`, which are drawn here."""
        every = [(kind, camera) for kind, cameras in views.items() for camera in cameras]
        pictures = [draw(scene, camera) for _, camera in every]
        shown = [number for number, picture in enumerate(pictures) if picture.any()]
        return cls(draw, [every[i] for i in shown], [pictures[i] for i in shown], most_db)

    def fewer(self, views: int) -> Judge[S]:
        """At most so many of the views, evenly spread over the kinds."""
        chosen = np.unique(np.linspace(0, len(self.views), views, endpoint=False).astype(int)) if self.views else []
        return Judge(self.draw, [self.views[i] for i in chosen], [self.pictures[i] for i in chosen], self.most_db)

    def quality(self, scene: S) -> Quality:
        """How good pictures of `scene` are."""
        pairs = zip(self.views, self.pictures, strict=True)
        found = [min(psnr(self.draw(scene, camera), picture), self.most_db) for (_, camera), picture in pairs]
        return Quality(tuple(kind for kind, _ in self.views), np.array(found, np.float64))
