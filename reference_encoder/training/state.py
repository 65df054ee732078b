"""Everything that a run learns and remembers, and the changes of its structure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from reference_encoder.training.anchors import ATTRIBUTES, AnchorLattice, Anchors, SceneNetworks, distinct
from reference_encoder.training.densification import AnchorStatistics, NewAnchors, inherit_latents
from reference_encoder.training.device import noise_generator
from reference_encoder.training.layers import LayerPlan, coarse
from reference_encoder.training.neural_gaussians import AnchorValues, in_view
from reference_encoder.training.optimizer import AnchorOptimizer, Rates
from reference_encoder.training.presets import Moment
from reference_encoder.training.rate import Context, Priced, neighbour_means
from reference_encoder.training.vq_features import VqFeatures
from scarfmt.render.camera import Camera

_START_WIDTHS = {"scaling": 0.1, "offsets": 0.1}
_LATENT_CELL = 0.5
"""First cells of latents, in their standard deviation."""
_CHUNK = 1024
WEIGHT_BITS = 8
"""Bits of the networks' weights in the file."""

_RATES = {
    "latent": (0.0075, 0.0015),
    "scaling": (0.007, 0.001),
    "log_widths": (0.005, 0.001),
    "log_offset_widths": (0.005, 0.001),
}
_NETWORK_RATES = {"decoder": (2e-3, 2e-5), "opacity": (2e-3, 2e-5), "cov": (4e-3, 4e-4), "color": (8e-3, 5e-5)}
_CONTEXT_RATES = (5e-3, 5e-4)


@dataclass
class State:
    """A scene in training, all of it on one device.

    Attributes:
        frame: where anchors lie.
        anchors: all that is learnt of each; leaves of `descent`.
        networks, context: what they share.
        log_widths: (6 + d,) of the last layer's cells of scalings and latents; `log_offset_widths`: (3,).
        descent: Adam over all of it.
        statistics: for growth.
        plan: layers.
        generator: of choices, on the processor; `noise`: of many numbers, on the device (`device.noise_generator`).
        extent: of the cameras, world units.
        exposures: (n, 2, 3) gains less 1 and offsets of the photos (:mod:`exposure`).
        vectors: codewords that carry features, None where latents are sent number by number.
        around: (N, columns) what neighbours had when last looked at; zeros for anchors that came since.
    """

    frame: AnchorLattice
    anchors: Anchors
    networks: SceneNetworks
    context: Context
    log_widths: Tensor
    log_offset_widths: Tensor
    descent: AnchorOptimizer = field(init=False)
    statistics: AnchorStatistics
    plan: LayerPlan
    generator: torch.Generator
    noise: torch.Generator = field(init=False)
    extent: float
    exposures: Tensor
    vectors: VqFeatures | None = None
    around: Tensor | None = None

    def __post_init__(self) -> None:
        self.noise = noise_generator(self.generator, self.device)
        shared = {"log_widths": self.log_widths, "log_offset_widths": self.log_offset_widths}
        nets = {f"networks.{name}": value for name, value in self.networks.named_parameters()}
        nets |= {f"context.{name}": value for name, value in self.context.named_parameters()}
        parameters = self.anchors.parameters() | shared | nets
        self.descent = AnchorOptimizer(parameters, {name: _rates(name, self.extent) for name in parameters})
        for name in ATTRIBUTES:
            setattr(self.anchors, name, self.descent.parameters[name])
        self.log_widths = self.descent.parameters["log_widths"]
        self.log_offset_widths = self.descent.parameters["log_offset_widths"]

    @property
    def device(self) -> torch.device:
        """The device of the tensors."""
        return self.anchors.lattice.device

    @torch.no_grad()
    def rearrange(self, rows: Tensor, fresh: Anchors) -> None:
        """Keep anchors `rows`, and add `fresh` ones."""
        anchors = self.anchors
        for name in ("lattice", "first", "born"):
            setattr(anchors, name, torch.cat([getattr(anchors, name)[rows], getattr(fresh, name)]))
        for name in ATTRIBUTES:
            setattr(anchors, name, self.descent.rearrange(name, rows, getattr(fresh, name)))
        self.statistics = self.statistics.select(rows, len(fresh))
        if self.vectors is not None:
            self.vectors.rearrange(rows, len(fresh))
        if self.around is not None:
            new = self.around.new_zeros(len(fresh), self.around.shape[1])
            self.around = torch.cat([self.around[rows], new])

    @torch.no_grad()
    def grow(self, growth: NewAnchors, iteration: int) -> None:
        """Add anchors that were asked for, after so many iterations."""
        size = torch.log(growth.size * self.frame.voxel)
        latent = inherit_latents(self.anchors.latent.detach(), growth)
        fresh = Anchors.fresh(growth.lattice, size, latent, iteration)
        self.rearrange(torch.arange(len(self.anchors), device=self.device), fresh)

    @torch.no_grad()
    def start_widths(self) -> None:
        """First cells of values, and what their distributions are like."""
        anchors = self.anchors
        widths = torch.full((6,), _START_WIDTHS["scaling"], device=self.device)
        values = anchors.scaling
        if self.vectors is None:
            spread = anchors.latent.std(dim=0).clamp_min(1e-3)
            widths = torch.cat([widths, _LATENT_CELL * spread])
            values = torch.cat([values, anchors.latent], dim=1)
        self.log_widths.copy_(widths.log())
        self.log_offset_widths.fill_(math.log(_START_WIDTHS["offsets"]))
        offsets = anchors.offsets[anchors.first < self.plan.count]
        self.context.start(values, offsets)

    @torch.no_grad()
    def update_neighbours(self) -> None:
        """Look at what neighbours have now."""
        everyone = torch.arange(len(self.anchors), device=self.device)
        self.around = neighbour_means(self.anchors.lattice, self.context.normalise(self._values(everyone)))

    def showing(self, layer: int) -> Tensor:
        """(n,) int64 rising: anchors of which a layer, 0-based, shows a slot."""
        return (self.anchors.first.min(dim=1).values <= layer).nonzero()[:, 0]

    def in_view(self, camera: Camera, layer: int) -> Tensor:
        """(V,) int64 rising: those :meth:`showing` of which a camera may see something."""
        a, rows = self.anchors, self.showing(layer)
        with torch.no_grad():
            lattice, scaling, offsets = (part.index_select(0, rows) for part in (a.lattice, a.scaling, a.offsets))
            return rows.index_select(0, in_view(self.frame.world(lattice), scaling, offsets, camera))

    def _values(self, rows: Tensor) -> Tensor:
        """(n, 6 + d) scalings and, where they are sent, latents."""
        # Never by [rows]: a gather that sums repeated rows in order takes four times as long, even of other rows.
        parts = [self.anchors.scaling] if self.vectors else [self.anchors.scaling, self.anchors.latent]
        return torch.cat([part.index_select(0, rows) for part in parts], dim=1)

    def open_slots(self) -> int:
        """Slots that are on in the last layer."""
        return int((self.anchors.first < self.plan.count).sum())

    def checkpoint(self) -> dict[str, Any]:
        """The whole state, for a checkpoint."""
        return {
            "anchors": {name: values.detach() for name, values in vars(self.anchors).items()},
            "networks": self.networks.state_dict(),
            "context": self.context.state_dict(),
            "widths": [self.log_widths.detach(), self.log_offset_widths.detach()],
            "descent": self.descent.state(),
            "statistics": dict(vars(self.statistics)),
            "generator": self.generator.get_state(),
            "noise": None if self.noise is self.generator else [self.device.type, self.noise.get_state()],
            "vectors": None if self.vectors is None else self.vectors.checkpoint(),
            "around": self.around,
            "exposures": self.exposures,
        }

    @torch.no_grad()
    def resume(self, saved: dict[str, Any]) -> None:
        """Take up a checkpoint, which is on the processor, of a run on any device."""
        none = torch.zeros(0, dtype=torch.long, device=self.device)
        self.rearrange(none, Anchors(**saved["anchors"]).to(self.device))
        self.networks.load_state_dict(saved["networks"])
        self.context.load_state_dict(saved["context"])
        self.log_widths.copy_(saved["widths"][0])
        self.log_offset_widths.copy_(saved["widths"][1])
        self.descent.load(saved["descent"])
        self.statistics = AnchorStatistics(**saved["statistics"]).to(self.device)
        self.generator.set_state(saved["generator"])
        self._resume_noise(saved.get("noise"))
        self.around = None if saved["around"] is None else saved["around"].to(self.device)
        self.exposures.copy_(saved["exposures"])
        if self.vectors is not None:
            self.vectors.resume(saved["vectors"])

    def _resume_noise(self, saved: list[Any] | None) -> None:
        if saved is not None and saved[0] == self.device.type:
            self.noise.set_state(saved[1])
        else:
            # No generator takes the state of another device's.
            self.noise = noise_generator(self.generator, self.device)

    def find_shown(self, rows: Tensor, layer: int) -> Tensor:
        """(n, K) bool, slots of anchors `rows` that a layer shows."""
        return self.anchors.first.index_select(0, rows) <= layer

    def exact(self, rows: Tensor) -> AnchorValues:
        """Values as they are, every slot on that the last layer opens."""
        a = self.anchors
        shown = self.find_shown(rows, self.plan.count - 1)
        lattice, latent, scaling, offsets = (
            part.index_select(0, rows) for part in (a.lattice, a.latent, a.scaling, a.offsets)
        )
        features = latent if self.vectors else self.networks.features(latent)
        return AnchorValues(self.frame.world(lattice), features, scaling, offsets, shown)

    def of_layer(self, rows: Tensor, layer: int, now: Moment | None) -> AnchorValues:
        """Values of anchors `rows` as a layer has them.

        Args:
            layer: 0-based.
            now: what is on: noise or rounding, how much of codewords; None for what the file has.
        """
        rounded = now is None or now.rounded
        priced = self.price(rows, layer, rounded)
        if self.vectors is None:
            features = self.networks.features(priced.values[:, 6:], WEIGHT_BITS if rounded else None)
        elif self.vectors.begun:
            features = self.vectors.features(self.anchors.latent.index_select(0, rows), rows, layer, now)
        else:
            features = self.anchors.latent.index_select(0, rows)
        positions = self.frame.world(self.anchors.lattice.index_select(0, rows))
        return AnchorValues(positions, features, priced.values[:, :6], priced.offsets, priced.shown)

    def price(self, rows: Tensor, layer: int, rounded: bool) -> Priced:
        """The values on which the bits of anchors `rows` depend in a layer: rounded as in the file, or with noise of a
        cell."""
        widths, offset_widths = torch.exp(self.log_widths), torch.exp(self.log_offset_widths)
        values, offsets = self._values(rows), self.anchors.offsets.index_select(0, rows)
        missing = self.missing(rows, layer)
        cells = widths * (3.0**missing)[:, None]
        if rounded:
            integers, offset_integers = self._integers(values, offsets, missing)
            values = _round_to_cells(values, cells.detach(), integers)
            offsets = _round_to_cells(offsets, offset_widths.detach(), offset_integers)
        else:
            values = values + self._noise(values.shape) * cells
            offsets = offsets + self._noise(offsets.shape) * offset_widths
        around = None if self.around is None else self.around.index_select(0, rows)
        return Priced(values, offsets, self.find_shown(rows, layer), cells, offset_widths, around)

    def integers(self, rows: Tensor, missing: Tensor) -> tuple[Tensor, Tensor]:
        """The whole numbers, as float32, that the file has of anchors `rows`.

        Args:
            missing: (n,) int64 ternary steps of each before the finest.

        Returns:
            (n, 6 + d) of scalings and, where they are sent, latents, `missing` steps before the finest; (n, K, 3) of
            offsets.
        """
        return self._integers(self._values(rows), self.anchors.offsets[rows], missing)

    @torch.no_grad()
    def _integers(self, values: Tensor, offsets: Tensor, missing: Tensor) -> tuple[Tensor, Tensor]:
        finest = torch.round(values / torch.exp(self.log_widths))
        return coarse(finest, missing), torch.round(offsets / torch.exp(self.log_offset_widths))

    def missing(self, rows: Tensor, layer: int) -> Tensor:
        """(n,) int64 ternary steps of anchors `rows` after a layer before the finest."""
        first = self.anchors.first.index_select(0, rows).min(dim=1).values.clamp(max=self.plan.count - 1)
        return self.plan.missing(layer, first)

    def _noise(self, shape: torch.Size) -> Tensor:
        """Uniform in -1/2..1/2, in steps of 2^-16: four numbers of each that is drawn."""
        words = torch.empty(-(-shape.numel() // 4), dtype=torch.int64, device=self.device)
        words.random_(-(1 << 63), None, generator=self.noise)
        return (words.view(torch.int16)[: shape.numel()].float() * 2.0**-16).reshape(shape)


def _rates(name: str, extent: float) -> Rates:
    if name == "offsets":
        return (0.01 * extent, 1e-4 * extent)
    if name.startswith("context."):
        return _CONTEXT_RATES
    if name.startswith("networks."):
        return next(rates for part, rates in _NETWORK_RATES.items() if part in name)
    return _RATES[name]


def _round_to_cells(values: Tensor, cells: Tensor, integers: Tensor) -> Tensor:
    """The middles of cells, their widths times `integers`; backward the identity of `values`."""
    return values + (integers * cells - values).detach()


def new_anchors(points: Tensor, frame: AnchorLattice, latent: int) -> Anchors:
    """An anchor on every lattice point that some of (P, 3) float64 `points` round to, sized by its neighbours."""
    lattice = distinct(torch.round((points - frame.origin) / frame.voxel).long())[0]
    size = torch.log(_neighbour_distance(frame.voxel * lattice.double()).clamp_min(1e-4 * frame.voxel))
    return Anchors.fresh(lattice, size.float(), torch.zeros(len(lattice), latent, device=lattice.device))


def _neighbour_distance(points: Tensor) -> Tensor:
    """(n,) root mean squared distance to the three nearest others."""
    squared = []
    for first in range(0, len(points), _CHUNK):
        chunk = points[first : first + _CHUNK].float()
        nearest = torch.cdist(chunk, points.float()).topk(min(4, len(points)), largest=False).values[:, 1:]
        squared.append((nearest.double() ** 2).mean(dim=1))
    return torch.cat(squared).sqrt()


def typical_distance(points: Tensor) -> float:
    """Median root mean squared distance of (P, 3) float64 points to their three nearest neighbours."""
    return float(_neighbour_distance(points).median())
