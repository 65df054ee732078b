"""The RVQ-VAE that is trained with the scene: projector, dual codebook, decoder (paper §3.2, §3.3, §3.5, §3.6).

Stage 1 has a coarse codebook, all later stages share a residual one, as the format does (SPEC §7.6). Indices are
chosen stage by stage by distortion plus lambda times bits. Until the last phase, books follow by moving averages;
then they are opened: gradients of pictures, and nothing else, move them.

    quantiser.fit(f, weight)                  projector and decoder, once, when quantisation begins
    quantiser.start(quantiser.project(f), weight)   books
    each step: z = quantiser.project(f);  indices = quantiser.choose(z.detach(), quantiser.bits(), lambda_)
               features, loss = quantiser(f, z, indices, stages);  loss.backward();  optimiser.step()
               quantiser.update(z.detach(), indices)
    last phase: quantiser.open_books()
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import nn
from torch.nn.functional import embedding

from reference_encoder.training.codebook import Codebook
from reference_encoder.training.fixed_order import LayerNorm, Linear, mean, product_over_rows, sum_over_rows, total
from reference_encoder.tuning import LEARNED_DECAY, RVQ_PRIOR_USES

_COMMITMENT = 0.25
"""Weight of the commitment loss, the paper's beta times lambda_commit."""
_WARM_STEPS, _WARM_BATCH, _WARM_RATE = 300, 4096, 3e-3
_SHORTEST = 1e-12
"""Below this length a direction is rounding noise."""


def rotation_trick(e: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
    """q, as |q| / |e| * R e with the ratio and the rotation R, which turns e towards q, constant in backpropagation.

    Fifty et al., "Restructuring Vector Quantization with the Rotation Trick" (ICLR 2025); paper §3.3. The
    angle between the gradient at q and q itself is the angle between the gradient at e and e. R is a
    product of two reflections, R = I - 2 r r^T + 2 q^ e^T with r the direction halfway between the unit
    vectors e^ and q^; where they are opposite there is no such direction and R is one reflection.
    Rows where e or q is zero have no rotation and go straight through.

    Args:
        e: (n, d) encoder output.
        q: (n, d) its quantised value.
    """
    with torch.no_grad():
        e_length, q_length = e.norm(dim=1, keepdim=True), q.norm(dim=1, keepdim=True)
        turns = (e_length > _SHORTEST) & (q_length > _SHORTEST)
        ratio = q_length / e_length.clamp_min(_SHORTEST)
        e_unit, q_unit = e / e_length.clamp_min(_SHORTEST), q / q_length.clamp_min(_SHORTEST)
        halfway = torch.nn.functional.normalize(e_unit + q_unit, dim=1, eps=1e-6)
    reflected = e - 2 * halfway * (halfway * e).sum(1, keepdim=True)
    turned = ratio * (reflected + 2 * q_unit * (e_unit * e).sum(1, keepdim=True))
    estimate = torch.where(turns, turned, e)
    # Equal to q up to rounding already; the correction makes it exact and has no gradient.
    return estimate + (q - estimate).detach()


class Quantiser(nn.Module):
    """Features to indices and back.

    Args:
        dimension: d_z, 1..64, at most `features`.
        features: D.
        stages: M, 1..8.
        codewords: of either book, 2..4096, codeword 0 being the zero vector.
        linear: a linear projector and decoder, and gradients straight through the quantiser, which measure best
            (decisions 0005 and 0054); else a hidden layer on both sides, LayerNorm after the projector and the
            rotation trick (paper §3.3, §3.6).
        seed: of everything random.
    """

    uses: torch.Tensor

    def __init__(
        self,
        dimension: int,
        features: int,
        stages: int = 4,
        codewords: int = 1024,
        *,
        linear: bool = True,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.stages, self.codewords, self.linear = stages, codewords, linear
        # Layers draw their first weights from torch's global generator.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.projector, self.decoder = _networks(dimension, features, self.linear)
        self.books = nn.ModuleList(Codebook(codewords, dimension) for _ in range(min(stages, 2)))
        self.register_buffer("uses", torch.full((stages, codewords), 1 / codewords))
        self._generator = torch.Generator().manual_seed(seed)
        self._open = False

    def get_extra_state(self) -> torch.Tensor:
        """State of the generator, for a checkpoint."""
        return self._generator.get_state()

    def set_extra_state(self, state: torch.Tensor) -> None:
        """Go on drawing from where a checkpoint was."""
        self._generator.set_state(state.cpu())

    def book(self, stage: int) -> Codebook:
        """The codebook of a stage, 0-based."""
        book = self.books[min(stage, 1)]
        assert isinstance(book, Codebook)
        return book

    def network_parameters(self) -> Iterator[nn.Parameter]:
        """The parameters of projector and decoder, for the optimiser of the VQ loss."""
        yield from self.projector.parameters()
        yield from self.decoder.parameters()

    def open_books(self) -> None:
        """From now on gradients move the codewords, not moving averages, and none restarts."""
        self._open = True
        self.books.requires_grad_(True)

    def project(self, f: torch.Tensor) -> torch.Tensor:
        """(n, d) latents of (n, D) features."""
        out: torch.Tensor = self.projector(f)
        return out

    def decode(self, z: torch.Tensor) -> torch.Tensor:
        """(n, D) features of (n, d) latents: a DECODER_MLP of one or two layers (SPEC §7.9)."""
        out: torch.Tensor = self.decoder(z)
        return out

    def fit(self, f: torch.Tensor, weight: torch.Tensor) -> None:
        """Projector and decoder for (n, D) features, n > 0, without any quantisation; (n,) `weight` of squared errors.

        Linear ones take the weighted principal axes, which no training beats; a squared distance of latents is then
        the squared error of features.
        """
        weight = _usable(weight.detach())
        if self.linear:
            self._fit_axes(f.detach().double(), weight.double())
        else:
            self._warm_up(f.detach(), weight)

    @torch.no_grad()
    def _fit_axes(self, f: torch.Tensor, weight: torch.Tensor) -> None:
        encoder, decoder = self.projector[0], self.decoder[0]
        assert isinstance(encoder, nn.Linear)
        assert isinstance(decoder, nn.Linear)
        centre = sum_over_rows(f * weight[:, None]) / total(weight)
        centred = f - centre
        covariance = product_over_rows(centred * weight[:, None], centred)
        axes = torch.linalg.eigh(covariance)[1].flip(1)[:, : encoder.out_features]
        # An eigenvector has no sign of its own.
        axes = axes * axes.gather(0, axes.abs().argmax(0, keepdim=True)).sign()
        encoder.weight.copy_(axes.T)
        encoder.bias.copy_(-(centre @ axes))
        decoder.weight.copy_(axes)
        decoder.bias.copy_(centre)

    def _warm_up(self, f: torch.Tensor, weight: torch.Tensor) -> None:
        optimiser = torch.optim.Adam(self.network_parameters(), lr=_WARM_RATE)
        chances, batch_size = weight.double().cpu(), min(_WARM_BATCH, len(f))
        for _ in range(_WARM_STEPS):
            drawn = torch.multinomial(chances, batch_size, replacement=True, generator=self._generator)
            batch = f[drawn.to(f.device)]
            loss = mean((self.decode(self.project(batch)) - batch).abs())
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()

    @torch.no_grad()
    def start(self, z: torch.Tensor, weight: torch.Tensor) -> None:
        """Books at weighted k-means centres of (n, d) latents, n > 0, stage by stage; (n,) `weight`.

        The shared book serves what every stage so far leaves, and moves on when another stage joins.
        """
        left, weight = z.detach(), _usable(weight.detach())
        seen: list[torch.Tensor] = []
        for stage in range(self.stages):
            book = self.book(stage)
            seen = [*seen, left] if stage > 1 else [left]
            book.fit(torch.cat(seen), weight.repeat(len(seen)), self._generator, fresh=stage < 2)
            left = left - book.words[book.nearest(left)]
        indices = self.choose(z)
        self.uses.copy_(self._frequencies(indices))

    @torch.no_grad()
    def choose(self, z: torch.Tensor, bits: torch.Tensor | None = None, lambda_: float = 0.0) -> torch.Tensor:
        """(n, M) int64 indices of least |z - e|^2 + lambda * bits, stage after stage.

        Args:
            z: (n, d) float32.
            bits: (M, codewords) price of each code, None for nothing.
            lambda_: squared units of z a bit.
        """
        left, out = z.detach(), []
        for stage in range(self.stages):
            codes = self.book(stage).nearest(left, None if bits is None else lambda_ * bits[stage])
            left = left - self.book(stage).words[codes]
            out.append(codes)
        return torch.stack(out, 1)

    def look_up(self, indices: torch.Tensor, stages: torch.Tensor | int | None = None) -> torch.Tensor:
        """(n, d) sums of the codewords of the first `stages`, one number or (n,), of (n, M) indices; None for all."""
        limit = self.stages if stages is None else stages
        total = torch.zeros(len(indices), self.book(0).words.shape[1], device=indices.device)
        for stage in range(self.stages):
            # The zero vector has no gradient.
            words = embedding(indices[:, stage], self.book(stage).words, padding_idx=0)
            if isinstance(limit, torch.Tensor):
                total = total + words * (limit > stage)[:, None]
            elif limit > stage:
                total = total + words
        return total

    def forward(
        self, f: torch.Tensor, encoded: torch.Tensor, indices: torch.Tensor, stages: int
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """(n, D) features of the first `stages`, with a gradient towards `encoded` and open books; the paper's loss.

        The loss (paper §3.5) is L1(f, f_q) + commitment * |z_e - sg(e)|^2. Its first f has no gradient: given
        `encoded` of detached features, it reaches only projector, decoder and open books.

        Args:
            f: (n, D).
            encoded: (n, d) latents of :meth:`project`.
            indices: (n, M) codewords.
        """
        words = self.look_up(indices, stages)
        straight = words.detach() + (encoded - encoded.detach())
        through = straight if self.linear else rotation_trick(encoded, words.detach())
        features = self.decode(through + (words - words.detach()))
        commitment = mean((encoded - self.look_up(indices).detach()).square())
        return features, mean((features - f.detach()).abs()) + _COMMITMENT * commitment

    @torch.no_grad()
    def update(self, z: torch.Tensor, indices: torch.Tensor) -> None:
        """One moving-average step towards (n, d) latents, n > 0, that chose (n, M) indices; call it after backward.

        Of open books only the frequencies of codes are followed.
        """
        seen, left = [], z.detach()
        for stage in range(self.stages):
            seen.append(left)
            left = left - self.book(stage).words[indices[:, stage]]
        self.uses.lerp_(self._frequencies(indices), 1 - LEARNED_DECAY)
        if self._open:
            return
        for number in range(len(self.books)):
            own = slice(1) if number == 0 else slice(1, None)
            stale = self.book(number).learn(torch.cat(seen[own]), indices[:, own].T.flatten(), self._generator)
            # Priced like the others: at the price of what nobody uses it would find no vectors.
            self.uses[own, stale] = 1 / self.codewords

    def _frequencies(self, indices: torch.Tensor) -> torch.Tensor:
        """(M, codewords) shares."""
        counts = [torch.bincount(column, minlength=self.codewords) for column in indices.T]
        return torch.stack(counts) / max(len(indices), 1)

    def bits(self) -> torch.Tensor:
        """(M, codewords) float32 bits of each code of each stage, by how often it has been used lately."""
        shares = self.uses + RVQ_PRIOR_USES / self.codewords
        return -torch.log2(shares / shares.sum(1, keepdim=True))


def _usable(weight: torch.Tensor) -> torch.Tensor:
    """Weights, all 1 where none is above 0."""
    return weight if bool((weight > 0).any()) else torch.ones_like(weight)


def _networks(dimension: int, features: int, linear: bool) -> tuple[nn.Sequential, nn.Sequential]:
    if linear:
        return nn.Sequential(Linear(features, dimension)), nn.Sequential(Linear(dimension, features))
    hidden = [Linear(features, features), nn.ReLU()]
    projector = nn.Sequential(*hidden, Linear(features, dimension), LayerNorm(dimension))
    return projector, nn.Sequential(Linear(dimension, features), nn.ReLU(), Linear(features, features))
