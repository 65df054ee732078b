"""Whether pictures lie on their photos: where poses do not fit together, surfaces are learnt between their places.

Wrong poses look like a scene that is merely hard: what was learnt is blurred, and no loss says why. But each picture
then lies beside its photo, in a direction of its own.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable

import torch
from torch import Tensor
from torch.nn import functional

from reference_encoder.training.similarity import intensities
from scarfmt.errors import InputWarning

LOOKS = 16
"""Pictures to look at."""
LIMIT = 0.3
"""Pixels: 0.06 to 0.17 were found of captures whose poses fit, 0.84 of one whose loop did not close."""
_BLOCK, _REACH = 32, 6
"""Pixels of a block's side, and how far it is looked for."""
_PLACES = 2 * _REACH + 1
_BLOCKS = 128
"""Looked for in one picture, at most."""
_LEAST_CONTRAST = 0.03
_LEAST_LIKENESS = 0.6
"""Correlation of a block with the place found for it: below, it shows something else."""
_LEAST_FOUND = 8


@torch.no_grad()
def displacement(pairs: Iterable[tuple[Tensor, Tensor]]) -> float:
    """Mean distance, pixels, by which pictures have to be moved onto their photos.

    Args:
        pairs: (H, W, 3) pictures, and photos as uint8.

    Returns:
        NaN where too little of any picture can be told apart.
    """
    moves = [torch.stack(_block_moves(picture, intensities(photo))) for picture, photo in pairs]
    # What is far off one way in one place and another elsewhere is noise; all of a picture going one way is its pose.
    distances = [float(torch.linalg.norm(each.median(dim=1).values)) for each in moves if each.shape[1] >= _LEAST_FOUND]
    return sum(distances) / len(distances) if distances else math.nan


def warn_of_displacement(distance: float) -> None:
    """Say what a :func:`displacement` that is too large means (`InputWarning`)."""
    if distance > LIMIT:
        message = (
            f"pictures lie {distance:.2f} pixels beside their photos on average: poses that do not fit together look"
            " like this, and blur what is learnt. Of a folder with the photos alone, poses are found anew"
        )
        warnings.warn(message, InputWarning, stacklevel=2)


def _block_moves(picture: Tensor, photo: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels, (b,) to the right and (b,) down, by which each block with enough detail has to be moved."""
    grey, seen = (colours.mean(dim=2).cpu() for colours in (picture, photo))
    corners = _corners(*grey.shape)
    if not corners:
        return torch.zeros(0), torch.zeros(0)
    wide = _BLOCK + 2 * _REACH
    blocks = torch.stack([grey[y + _REACH :, x + _REACH :][:_BLOCK, :_BLOCK] for y, x in corners])
    windows = torch.stack([seen[y:, x:][:wide, :wide] for y, x in corners])
    likeness = _correlations(blocks, windows)
    best, place = likeness.flatten(1).max(dim=1)
    down, right = place // _PLACES, place % _PLACES
    each = torch.arange(len(blocks))
    moves = _peak(likeness[each, down], right) - _REACH, _peak(likeness[each, :, right], down) - _REACH
    distinctive = (best > _LEAST_LIKENESS) & (blocks.flatten(1).std(dim=1) > _LEAST_CONTRAST)
    return moves[0][distinctive], moves[1][distinctive]


def _peak(rows: Tensor, place: Tensor) -> Tensor:
    """(b,) tops of the parabolas through the largest of each of (b, s) numbers, at (b,) `place`, and its neighbours."""
    within = place.clamp(1, rows.shape[1] - 2)
    before, here, after = (rows.gather(1, within[:, None] + step)[:, 0] for step in (-1, 0, 1))
    bend = before - 2 * here + after
    shift = torch.where(bend < 0, (before - after) / (2 * bend.clamp_max(-1e-9)), 0.0).clamp(-0.5, 0.5)
    return torch.where(within == place, within + shift, place.float())


def _corners(height: int, width: int) -> list[tuple[int, int]]:
    """Rows and columns where the windows of blocks begin, spread over a picture."""
    wide = _BLOCK + 2 * _REACH
    every = [(y, x) for y in range(0, height - wide + 1, _BLOCK) for x in range(0, width - wide + 1, _BLOCK)]
    return every[:: -(-len(every) // _BLOCKS)] if every else []


def _correlations(blocks: Tensor, windows: Tensor) -> Tensor:
    """(b, s, s) of (b, k, k) blocks with every place in their (b, k + s - 1, k + s - 1) windows, -1..1."""
    kernels = blocks - blocks.mean(dim=(1, 2), keepdim=True)
    products = functional.conv2d(windows[None], kernels[:, None], groups=len(blocks))[0]
    mean = functional.avg_pool2d(windows, _BLOCK, stride=1)
    spread = functional.avg_pool2d(windows * windows, _BLOCK, stride=1) - mean * mean
    norms = kernels.flatten(1).norm(dim=1)[:, None, None] * (spread.clamp_min(1e-9) * _BLOCK**2).sqrt()
    correlations: Tensor = products / norms.clamp_min(1e-9)
    return correlations
