"""Entropy-constrained quantisation with the index network's own prices (encoder side; paper §3.2, §3.4).

Static prices choose the first indices; a network trained on them knows better what each codeword costs where. Here
every anchor's indices are chosen again, minimising weight * |latent - codewords|^2 + lambda * bits over its stages
together by a beam search, and the LATENT channel is fitted to what they leave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from reference_encoder.entropy.dataset import IndexRows
from reference_encoder.entropy.model import IndexModel
from reference_encoder.entropy.view import NetworkView
from reference_encoder.leftovers import Leftovers, leftovers
from reference_encoder.targets import Targets
from scarfmt.codecs.codebooks import Codebooks
from scarfmt.writer import QuantisedScene

I16 = NDArray[np.int16]
I64 = NDArray[np.int64]

BEAM = 4
"""Partial choices kept from stage to stage."""
_FINALISTS = 16
"""Whole choices that are compared by what they really cost."""
_CHUNK = 512
"""Anchors worked on at a time: prices of every codeword after each of their beams stay in the cache."""


def rechosen(
    scene: QuantisedScene,
    model: IndexModel,
    view: NetworkView,
    targets: Targets,
    report: Callable[[float], None] = lambda _fraction: None,
    beam: int = BEAM,
) -> QuantisedScene:
    """The scene with indices that `model` finds cheaper for what they show, and LATENT values that fit them.

    Neighbours' indices are inputs of the network, and taken as they were: prices are exact only if few change.

    Args:
        scene: whose indices `model` was trained on, books in the order of its clusters.
        report: told the fraction done.
    """
    contents, first, rests = [], 0, leftovers(scene, targets)
    for tile, content in enumerate(scene.contents):
        part = slice(first, first + len(content))
        rows = view.rows(scene, (tile,))
        chooser = Chooser.of(scene, model, rows, targets.take(part), content.classes, rests)
        contents.append(replace(content, indices=chooser.chosen(content.indices, beam)))
        first = part.stop
        report(first / max(len(targets.weight), 1))
    return targets.refined(replace(scene, contents=tuple(contents)))


@dataclass(frozen=True)
class Chooser:
    """Chooses the indices of one tile.

    Attributes:
        model: trained network.
        books: (n, d) float32 codewords, coarse and residual.
        embedded: (rows, H) what the network sees round the anchor of each row.
        row: (n, M) row that codes each stage of each anchor, -1 for stages it does not get.
        latents: (n, d) float32.
        worth: (n,) float32 bits that a squared lattice unit of error is worth: weight / lambda.
        classes: (n,) int64.
        rests: of every class, what it costs to leave something.
    """

    model: IndexModel
    books: tuple[torch.Tensor, torch.Tensor]
    embedded: torch.Tensor
    row: torch.Tensor
    latents: torch.Tensor
    worth: torch.Tensor
    classes: torch.Tensor
    rests: tuple[Leftovers, ...]

    @classmethod
    def of(
        cls,
        scene: QuantisedScene,
        model: IndexModel,
        rows: IndexRows,
        targets: Targets,
        classes: I64,
        rests: Sequence[Leftovers],
    ) -> Chooser:
        """For all `rows` of a tile whose anchors' `targets` and `classes` are given."""
        books = scene.codebooks
        assert books is not None
        inputs = torch.from_numpy(rows.inputs)
        with torch.no_grad():
            parts = [model.embed(part.float(), True) for part in torch.split(inputs, _CHUNK)]
        embedded = torch.cat(parts) if parts else torch.zeros(0, model.shape.hidden)
        return cls(
            model,
            _words(books),
            embedded,
            torch.from_numpy(_row_of_stage(rows, len(targets.weight))),
            torch.from_numpy(targets.latents),
            torch.from_numpy((targets.weight / targets.rate).astype(np.float32)),
            torch.from_numpy(classes),
            tuple(rests),
        )

    def chosen(self, indices: I16, beam: int = BEAM) -> I16:
        """(n, M) indices, none of which costs more than the given ones by the network's prices."""
        out = torch.from_numpy(indices.astype(np.int64))
        with torch.no_grad():
            for stages, rests, anchors in self._groups():
                out[anchors, :stages] = self._chosen(anchors, out[anchors, :stages], rests, beam)
        return out.numpy().astype(np.int16)

    def costs(self, indices: I16) -> NDArray[np.float64]:
        """(n,) bits of the given indices, and of the error they leave; 0 for anchors without a stage."""
        codes = torch.from_numpy(indices.astype(np.int64))
        out = torch.zeros(len(codes))
        with torch.no_grad():
            for stages, rests, anchors in self._groups():
                out[anchors] = self._cost(anchors, codes[anchors, :stages], rests)
        return out.double().numpy()

    def _groups(self) -> Iterator[tuple[int, Leftovers, torch.Tensor]]:
        """(stages, cost of what they leave, anchors) of a class, a chunk at a time."""
        received = (self.row >= 0).sum(1)
        for kind, rests in enumerate(self.rests):
            anchors = torch.nonzero((self.classes == kind) & (received > 0))[:, 0]
            for part in torch.split(anchors, _CHUNK) if len(anchors) else ():
                yield int(received[part[0]]), rests, part

    def _chosen(self, anchors: torch.Tensor, now: torch.Tensor, rests: Leftovers, beam: int) -> torch.Tensor:
        """(m, stages) indices of anchors that get as many stages as they have in `now`."""
        paths, left, spent = self._search(anchors, now.shape[1], rests, beam)
        width = len(paths) // len(anchors)
        costs = (spent + rests.costs(left, self.worth[anchors].repeat_interleave(width))).reshape(-1, width)
        cost, best = costs.min(1)
        found = paths[torch.arange(len(anchors)) * width + best]
        better = cost < self._cost(anchors, now, rests)
        return torch.where(better[:, None], found, now)

    def _search(
        self, anchors: torch.Tensor, stages: int, rests: Leftovers, beam: int
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Some good indices for each anchor, side by side: (m * w, stages) indices, what they leave, their bits."""
        count, owner = len(anchors), torch.arange(len(anchors))
        paths = torch.zeros(count, 0, dtype=torch.long)
        left, spent = self.latents[anchors], torch.zeros(count)
        for stage in range(1, stages + 1):
            book = self.books[min(stage - 1, 1)]
            prices = self._prices(anchors[owner], paths, stage).add_(spent[:, None])
            steep = left * rests.slope
            scores = torch.addmm((book * book) @ rests.slope, steep, book.T, alpha=-2)
            scores.add_((left * steep).sum(1, keepdim=True)).mul_(self.worth[anchors[owner], None]).add_(prices)
            keep = min(beam if stage < stages else _FINALISTS, len(book))
            place = torch.topk(scores.reshape(count, -1), keep, dim=1, largest=False).indices
            before = (torch.arange(count)[:, None] * (len(owner) // count) + place // len(book)).flatten()
            code = (place % len(book)).flatten()
            paths, spent = torch.cat([paths[before], code[:, None]], 1), prices[before, code]
            left, owner = left[before] - book[code], owner[before]
        return paths, left, spent

    def _prices(self, anchors: torch.Tensor, paths: torch.Tensor, stage: int) -> torch.Tensor:
        """(m, codewords) bits of every index of a stage after the earlier ones in `paths`."""
        states = self.model.histories(paths, True, stage - 1)
        y = self.model.context(self.embedded[self.row[anchors, stage - 1]], states, True)
        return self.model.head(min(stage - 1, 1)).all_bits(y, True)

    def _cost(self, anchors: torch.Tensor, codes: torch.Tensor, rests: Leftovers) -> torch.Tensor:
        """(m,) bits of given indices, and of the error they leave."""
        left, spent = self.latents[anchors].clone(), torch.zeros(len(anchors))
        for stage in range(1, codes.shape[1] + 1):
            code = codes[:, stage - 1]
            spent += self._prices(anchors, codes[:, : stage - 1], stage).gather(1, code[:, None])[:, 0]
            left -= self.books[min(stage - 1, 1)][code]
        return spent + rests.costs(left, self.worth[anchors])


def _words(books: Codebooks) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.from_numpy(books.coarse.astype(np.float32)), torch.from_numpy(books.residual.astype(np.float32))


def _row_of_stage(rows: IndexRows, anchors: int) -> I64:
    """(anchors, M) row that codes each stage, -1 for none."""
    out = np.full((anchors, rows.codes.shape[1]), -1, np.int64)
    for stage in range(1, rows.codes.shape[1] + 1):
        coding = np.flatnonzero((rows.before < stage) & (rows.after >= stage))
        out[rows.places[coding, 1], stage - 1] = coding
    return out
