"""Features of anchors as codewords, when the paper's quantiser carries them (paper §3.2, §3.5, §3.6)."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from reference_encoder.training.curriculum import Moment
from reference_encoder.training.fixed_latents import Coordinates
from reference_encoder.training.quantiser import Quantised, Quantiser

_RATE, _LAST_RATE = 1e-3, 1e-4
"""Learning rates of projector and decoder on their own loss, and when pictures move them and the books too."""
_MEMORY = 0.99
_ECVQ = 0.5
"""The price of a bit when codewords are chosen, as a share of the slope of distortion by bits of an ideal quantiser."""


_TURNS = 8
"""Looks at an anchor between two choices of its codewords: choosing takes several times as long as all else."""


class Vectors:
    """The quantiser of a scene in training, its own optimiser, and what it does now.

    Args:
        quantiser: of M stages, on the device of the run.
        stages: how many of them each layer has.
        priced: whether codewords are chosen by distortion and bits in the hard phase.
    """

    def __init__(self, quantiser: Quantiser, stages: tuple[int, ...], priced: bool = True) -> None:
        self.quantiser, self.stages, self.priced = quantiser, stages, priced
        self.begun, self.opened = False, False
        self.distortion = 0.0
        self.loss: Tensor | None = None
        self.coordinates: Coordinates | None = None
        self._seen: tuple[Tensor, Tensor] | None = None
        self._chosen: Tensor | None = None
        self._turn = 0
        self._optimiser = torch.optim.Adam(list(quantiser.network_parameters()), lr=_RATE)

    def begin(self, latent: Tensor, weight: Tensor) -> None:
        """Fit projector and decoder to (N, D) features, and books to what they make of them; (N,) importance."""
        self.begun = True
        self.quantiser.fit(latent, weight)
        self.quantiser.start(self.quantiser.project(latent), weight)
        self._chosen = self._unknown(len(latent))

    def rearrange(self, rows: Tensor, fresh: int) -> None:
        """Keep anchors `rows`, and take in `fresh` ones."""
        if self._chosen is not None:
            self._chosen = torch.cat([self._chosen[rows], self._unknown(fresh)])

    def _unknown(self, count: int) -> Tensor:
        """(count, M) codewords of anchors that have none yet."""
        device = self.quantiser.uses.device
        return torch.full((count, self.quantiser.stages), -1, device=device)

    def open(self) -> None:
        """From now on pictures move books, projector and decoder."""
        self.opened = True
        self.quantiser.open_books()
        parameters = [*self.quantiser.network_parameters(), *self.quantiser.book_parameters()]
        self._optimiser = torch.optim.Adam(parameters, lr=_LAST_RATE)

    def features(self, latent: Tensor, rows: Tensor, layer: int, now: Moment | None) -> Tensor:
        """(n, D) features that a picture of a layer is made of.

        Args:
            latent: (n, D) continuous features.
            rows: (n,) int64 of which anchors.
            layer: 0-based.
            now: None for those of the file.
        """
        if now is None:
            with torch.no_grad():
                shown: Tensor = self.quantiser.decode(self.quantiser.look_up(self.codes(latent), self.stages[layer]))
                return shown
        indices = self._choose(latent.detach(), rows, self._price() if now.hard else 0.0)
        given = latent if now.hard else latent.detach()
        made: Quantised = self.quantiser(given, self.stages[layer], indices=indices)
        self.loss, self._seen = made.loss, (made.encoded, made.indices)
        if now.hard:
            return made.features
        shown = latent + now.beta * (made.features - latent).detach()
        kept: Tensor = now.feature_gradient * latent
        return kept + (shown - kept).detach()

    @torch.no_grad()
    def _choose(self, latent: Tensor, rows: Tensor, price: float) -> Tensor:
        """(n, M) int64 codewords of features, chosen now for anchors whose turn it is and for those that have none."""
        assert self._chosen is not None
        self._turn += 1
        indices = self._chosen[rows]
        due = ((rows + self._turn) % _TURNS == 0) | (indices[:, 0] < 0)
        encoded = self.quantiser.project(latent[due])
        indices[due] = self.quantiser.choose(encoded, self.quantiser.bits(), price)
        self._chosen[rows] = indices
        return indices

    def codes(self, latent: Tensor) -> Tensor:
        """(n, M) int64 codewords of (n, D) features, as the file has them."""
        with torch.no_grad():
            price = self._price() if self.opened else 0.0
            return self.quantiser.choose(self.quantiser.project(latent), self.quantiser.bits(), price)

    def index_bits(self, layer: int) -> float:
        """Bits of an anchor's indices in a layer, under tables of their frequencies."""
        uses = self.quantiser.uses
        entropy = -(uses * torch.log2(uses.clamp_min(1e-12))).sum(dim=1)
        return float(entropy[: self.stages[layer]].sum())

    def step(self) -> None:
        """One step of the quantiser's own optimiser, and of its books, after backward."""
        if self.loss is None or self._seen is None:
            return
        self._optimiser.step()
        self._optimiser.zero_grad(set_to_none=True)
        encoded, indices = self._seen
        left = encoded - self.quantiser.look_up(indices).detach()
        self.distortion = _MEMORY * self.distortion + (1 - _MEMORY) * float(left.square().sum(dim=1).mean())
        self.quantiser.update(encoded, indices)
        self.loss = self._seen = None

    def _price(self) -> float:
        """Squared units of z that a bit is worth: a bit more of d dimensions takes 2 ln 2 / d of the distortion."""
        dimension = self.quantiser.book(0).words.shape[1]
        return _ECVQ * 2 * math.log(2) / dimension * self.distortion if self.priced else 0.0

    def checkpoint(self) -> dict[str, Any]:
        """For a checkpoint; moments of the optimiser are left out."""
        flags = {"begun": self.begun, "opened": self.opened, "distortion": self.distortion}
        return {"quantiser": self.quantiser.state_dict(), "chosen": self._chosen, "turn": self._turn, **flags}

    def resume(self, kept: dict[str, Any]) -> None:
        """Take up a checkpoint."""
        self.quantiser.load_state_dict(kept["quantiser"])
        self.begun, self.distortion = kept["begun"], kept["distortion"]
        chosen, self._turn = kept["chosen"], kept["turn"]
        self._chosen = None if chosen is None else chosen.to(self.quantiser.uses.device)
        if kept["opened"]:
            self.open()
