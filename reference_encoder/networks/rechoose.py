"""Entropy-constrained quantisation with the index network's own prices (encoder side; paper §3.2, §3.4).

Static prices choose the first indices; a network trained on them knows better what each codeword costs where. Here
every anchor's indices are chosen again, minimising weight * |latent - codewords|^2 + lambda * bits over its stages
together by a beam search, and the LATENT channel is fitted to what they leave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from reference_encoder.decide.targets import Targets
from reference_encoder.networks.codeword_search import CodewordSearch
from reference_encoder.networks.dataset import IndexRows
from reference_encoder.networks.leftovers import Leftovers, leftovers
from reference_encoder.networks.model import IndexModel
from reference_encoder.networks.view import NetworkView
from reference_encoder.tuning import BEAM, FINALISTS
from scarfmt.arrays import I16, I64
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene
from scarfmt.scene.codebooks import Codebooks

_CHUNK = 2048
"""Anchors worked on at a time: fewer, and calls cost more than what they do."""


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
    rests, edges = leftovers(scene, targets), np.cumsum([0, *map(len, scene.contents)])

    def content(tile: int) -> TileContent:
        old, part = scene.contents[tile], slice(int(edges[tile]), int(edges[tile + 1]))
        chooser = Chooser.of(scene, model, view.rows(scene, (tile,)), targets.take(part), old.classes, rests)
        return replace(old, indices=chooser.chosen(old.indices, beam))

    contents = []
    # Tiles are chosen by themselves, so threads change nothing.
    with ThreadPoolExecutor(torch.get_num_threads()) as pool:
        for done in pool.map(content, range(len(scene.contents))):
            contents.append(done)
            report(int(edges[len(contents)]) / max(int(edges[-1]), 1))
    return targets.refined(replace(scene, contents=tuple(contents)))


@dataclass(frozen=True)
class Chooser:
    """Chooses the indices of one tile.

    Attributes:
        model: trained network.
        searches: of the coarse and of the residual book.
        started: G_0 and G_1 after every coarse codeword, (n, H) each.
        embedded: (rows, H) what the network sees round the anchor of each row.
        row: (n, M) row that codes each stage of each anchor, -1 for stages it does not get.
        latents: (n, d) float32.
        worth: (n,) float32 bits that a squared lattice unit of error is worth: weight / lambda.
        classes: (n,) int64.
        rests: of every class, what it costs to leave something.
    """

    model: IndexModel
    searches: tuple[CodewordSearch, ...]
    started: tuple[torch.Tensor, ...]
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
            searches = _searches(books, model)
            started = _started(model, len(books.coarse))
            parts = [model.embed(part.float(), True) for part in torch.split(inputs, _CHUNK)]
        embedded = torch.cat(parts) if parts else torch.zeros(0, model.shape.hidden)
        return cls(
            model,
            searches,
            started,
            embedded,
            torch.from_numpy(_row_of_stage(rows, len(targets.weight))),
            torch.from_numpy(targets.latents),
            torch.from_numpy((targets.weight / targets.lambda_).astype(np.float32)),
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
        for klass, rests in enumerate(self.rests):
            anchors = torch.nonzero((self.classes == klass) & (received > 0))[:, 0]
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
        left, spent, worth = self.latents[anchors], torch.zeros(count), self.worth[anchors]
        for stage in range(1, stages + 1):
            search = self._stage(stage)
            y = self._context(anchors[owner], paths, stage)
            keep = min(beam if stage < stages else FINALISTS, len(search.words))
            place, code, bits = search.cheapest(left, y, spent, worth, rests.slope, keep)
            before, code = (torch.arange(count)[:, None] * (len(owner) // count) + place).flatten(), code.flatten()
            paths, spent = torch.cat([paths[before], code[:, None]], 1), bits.flatten()
            left, owner = left[before] - search.words[code], owner[before]
        return paths, left, spent

    def _stage(self, stage: int) -> CodewordSearch:
        return self.searches[min(stage - 1, 1)]

    def _context(self, anchors: torch.Tensor, paths: torch.Tensor, stage: int) -> torch.Tensor:
        """(m, Y) what a stage's head sees after the earlier indices in `paths`."""
        if stage == 2:
            states = [state[paths[:, 0]] for state in self.started]
        else:
            states = self.model.histories(paths, True, stage - 1)
        return self.model.context(self.embedded[self.row[anchors, stage - 1]], states, True)

    def _cost(self, anchors: torch.Tensor, codes: torch.Tensor, rests: Leftovers) -> torch.Tensor:
        """(m,) bits of given indices, and of the error they leave."""
        left, spent = self.latents[anchors].clone(), torch.zeros(len(anchors))
        for stage in range(1, codes.shape[1] + 1):
            code, search = codes[:, stage - 1], self._stage(stage)
            spent += search.head.bits(self._context(anchors, codes, stage), code, True)
            left -= search.words[code]
        return spent + rests.costs(left, self.worth[anchors])


def _searches(books: Codebooks, model: IndexModel) -> tuple[CodewordSearch, ...]:
    words = [torch.from_numpy(book.astype(np.float32)) for book in (books.coarse, books.residual)]
    return tuple(CodewordSearch.of(words[number], model.head(number)) for number in range(len(model.heads)))


def _started(model: IndexModel, codewords: int) -> tuple[torch.Tensor, ...]:
    """G_0 and G_1 after every coarse codeword; nothing where there is no second stage."""
    if model.stages < 2:
        return ()
    return tuple(model.histories(torch.arange(codewords)[:, None], True, 1))


def _row_of_stage(rows: IndexRows, anchors: int) -> I64:
    """(anchors, M) row that codes each stage, -1 for none."""
    out = np.full((anchors, rows.codes.shape[1]), -1, np.int64)
    for stage in range(1, rows.codes.shape[1] + 1):
        coding = np.flatnonzero((rows.before < stage) & (rows.after >= stage))
        out[rows.places[coding, 1], stage - 1] = coding
    return out
