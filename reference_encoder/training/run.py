"""Training: from a capture to the bytes of a file, whatever interrupts it (paper §3; SPEC §5-§8)."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from reference_encoder.judge.reconstruct import reconstruct_anchors
from reference_encoder.opening_view import middle_camera
from reference_encoder.streaming_block import build_streaming_block
from reference_encoder.training.anchors import AnchorLattice, SceneNetworks
from reference_encoder.training.budget import Budget
from reference_encoder.training.capture import Capture
from reference_encoder.training.densification import AnchorStatistics
from reference_encoder.training.device import reproducible, run_device
from reference_encoder.training.evaluate import draw, quality
from reference_encoder.training.exposure import spread
from reference_encoder.training.fixed_order import one_thread
from reference_encoder.training.index_entropy import JointIndexModel
from reference_encoder.training.layers import LayerPlan
from reference_encoder.training.options import (
    FINISHING,
    LayerQuality,
    Progress,
    Report,
    Stop,
    Suspended,
    Trained,
    TrainOptions,
    never,
    silent,
)
from reference_encoder.training.photo_store import View, half_size, store_photos
from reference_encoder.training.pose_check import LOOKS, displacement, warn_of_displacement
from reference_encoder.training.presets import CODEWORDS, DIMENSION, PRESETS, Preset
from reference_encoder.training.quantiser import Quantiser
from reference_encoder.training.rate import Context
from reference_encoder.training.rate_controller import LEAST_PRICE, RateController
from reference_encoder.training.room import check_room
from reference_encoder.training.run_folder import RunLog, identity, load_checkpoint, save_checkpoint, save_draft
from reference_encoder.training.smallest import nowhere, smallest_file
from reference_encoder.training.state import State, new_anchors, typical_distance
from reference_encoder.training.trainer import Trainer
from reference_encoder.training.vq_features import VqFeatures
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.errors import InputWarning, plural

VOXEL = 0.5
"""Edge of a voxel, as a share of the median distance of a starting point to its nearest neighbours."""
EXTENT = 1.1
_LAST_PRICE, _CHEAPER = 0.015, 2.0
"""Loss for a bit a pixel of all photos in the last layer, and how many times more it is in each layer before."""
_CHECK_ITERATIONS, _CHECK_PHOTOS = 500, 8
"""Iterations between two looks at held-out photos, and at how many of them."""
_LEAST_SEEN, _LEAST_ITERATIONS = 10, 500
"""How often each photo is learnt from at least, and iterations, of a run that has converged."""
_FALL = 1.0
"""dB that the end of such a run may lie below what was measured on the way."""
_SAVE_SECONDS = 180.0
_SETTLED = 0.25
"""Fraction of the run after which pictures lie where they will."""
_MEMORY = 0.98


def camera_spacing(eyes: Tensor) -> float:
    """Median distance of (n, 3) cameras, at least one, to the nearest other; 0 of one alone."""
    if len(eyes) < 2:
        return 0.0
    distances = torch.cdist(eyes, eyes)
    distances.fill_diagonal_(torch.inf)
    return float(distances.amin(dim=1).median())


def make_trainer(capture: Capture, options: TrainOptions, folder: Path | None = None) -> Trainer:
    """A run before its first iteration.

    Args:
        folder: for the pixels of photos, see :func:`store_photos`.

    Raises:
        InvalidInput: as of :func:`run_device`.
    """
    device, preset = run_device(options.device), PRESETS[options.preset]
    views = store_photos(capture.train, folder)
    eyes = np.stack([view.camera.centre for view in views])
    extent = EXTENT * float(np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).max(initial=1e-6))
    points = torch.from_numpy(capture.points)
    plan = LayerPlan.of(options.layers, options.last_layer)
    frame = AnchorLattice.round(points, VOXEL * typical_distance(points))
    anchors = new_anchors(points, frame, preset.features)
    priced = 6 + (0 if preset.stages else preset.features)
    state = State(
        frame=frame.to(device),
        anchors=anchors.to(device),
        networks=SceneNetworks(preset.features, options.seed).to(device),
        context=Context(priced, options.seed).to(device),
        log_widths=torch.zeros(priced, device=device),
        log_offset_widths=torch.zeros(3, device=device),
        statistics=AnchorStatistics.of(len(anchors), device),
        plan=plan,
        generator=torch.Generator().manual_seed(options.seed),
        extent=extent,
        exposures=torch.zeros(len(views), 2, 3, device=device),
        vectors=_vq_features(preset, plan.count, options.seed, device),
    )
    pixel_count = sum(view.camera.width * view.camera.height for view in views)
    price = [options.lambda_ * _LAST_PRICE * _CHEAPER ** (plan.count - 1 - layer) for layer in range(plan.count)]
    wanted = None if options.size is None else [options.size * share for share in plan.shares]
    return Trainer(
        state=state,
        rate_controller=RateController(price, pixel_count, wanted, LEAST_PRICE * options.lambda_),
        views=views,
        small=half_size(views) or views,
        curriculum=preset.curriculum,
        background=torch.zeros(3, device=device),
        camera_jitter=preset.camera_jitter * camera_spacing(torch.from_numpy(eyes)),
        joint=JointIndexModel(preset.paper, options.seed) if preset.stages else None,
    )


def _vq_features(preset: Preset, layers: int, seed: int, device: torch.device) -> VqFeatures | None:
    """The quantiser of a run on a device, None where latents are sent number by number."""
    if not preset.stages:
        return None
    sizes = DIMENSION, preset.features, preset.stages, CODEWORDS
    quantiser = Quantiser(*sizes, linear=not preset.paper, seed=seed)
    by_layer = tuple(max(1, round((layer + 1) * preset.stages / layers)) for layer in range(layers))
    return VqFeatures(quantiser.to(device), by_layer, priced=not preset.paper)


_KEPT = ("psnr", "best", "bytes", "loss")
"""What a checkpoint has of a run."""


class Run:
    """A training that goes on: its trainer, its budget, what it has found so far."""

    def __init__(self, capture: Capture, options: TrainOptions, report: Report, folder: Path | None) -> None:
        self.report = report
        self.budget = Budget(options, capture.seconds)
        with one_thread():  # so that a run is taken up on the same lattice, whatever its number of threads
            self.trainer = make_trainer(capture, options, folder)
        self.held_out = store_photos(capture.test, folder)
        self.psnr: float | None = None
        self.best = -math.inf
        self.bytes: int | None = None
        self.displacement: float | None = None
        self.loss = float("nan")
        self.saved = time.monotonic()
        self.budget.begin()

    def state(self) -> dict[str, Any]:
        """For a checkpoint."""
        own = {name: getattr(self, name) for name in _KEPT} | {"trained": self.budget.trained}
        return {"run": own, "trainer": self.trainer.checkpoint()}

    def load(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.trainer.resume(state["trainer"])
        own = dict(state["run"])
        self.budget.before = own.pop("trained")
        vars(self).update(own)

    def step(self) -> bool:
        """One iteration; False when the run is over."""
        done = self.budget.done(self.trainer.iteration)
        if done >= 1:
            return False
        loss = self.trainer.step(done)
        self.loss = loss if math.isnan(self.loss) else _MEMORY * self.loss + (1 - _MEMORY) * loss
        self.report(self.progress())
        return True

    def progress(self) -> Progress:
        """The progress of the run."""
        trainer, budget = self.trainer, self.budget
        done = max(budget.done(trainer.iteration), 1e-9)
        left = budget.seconds - budget.spent if budget.iterations is None else budget.spent * (1 - done) / done
        return Progress(
            iteration=trainer.iteration,
            iterations=budget.plan(trainer.iteration),
            seconds=budget.spent,
            seconds_left=max(left, 0.0),
            phase=trainer.phase(done),
            psnr=self.psnr,
            bytes=self.bytes,
            anchors=len(trainer.state.anchors),
            gaussians=trainer.state.open_slots(),
            loss=self.loss,
        )

    def check_due(self) -> bool:
        """Whether it is time to look at held-out photos."""
        return self.budget.check_due(self.trainer.iteration, _CHECK_ITERATIONS)

    def check(self) -> dict[str, Any]:
        """Look at held-out photos and at what the writer makes of the values as they are; figures for the log."""
        with self.budget.checking():
            trainer = self.trainer
            layer = trainer.state.plan.count - 1 if trainer.noisy else None
            self.psnr, _ = self._quality(evenly(self.held_out, _CHECK_PHOTOS), layer)
            self.best = max(self.best, self.psnr)
            figures: dict[str, Any] = {"prices": str(trainer.rate_controller.price)}
            if trainer.noisy:
                with self.budget.note("coding"):
                    sizes = layer_sizes(write_scene(trainer.quantise()))
                self.bytes = sizes[-1]
                figures |= {"estimated": str(trainer.rate_controller.estimate), "written": str(sizes)}
                if len(sizes) == len(trainer.rate_controller.price):
                    trainer.rate_controller.record_sizes(sizes)
            if self.displacement is None and self._has_settled():
                self.displacement = self._displacement()
                warn_of_displacement(self.displacement)
            figures |= {"displacement": self.displacement, "exposure_spread": spread(trainer.state.exposures)}
            self._expect()
            if trainer.joint is not None:
                figures |= {"index_bits_an_anchor": trainer.index_bits, "hash_bits": trainer.joint.hash_bits}
            return figures

    def _expect(self) -> None:
        """Tell the budget what the end will take."""
        budget, trainer, count = self.budget, self.trainer, self.trainer.state.plan.count
        looks = budget.looks(count, len(self.held_out)) * count
        budget.pictures = looks + min(LOOKS, len(trainer.views))
        if trainer.joint is not None:
            budget.indexed, budget.costs["index"] = True, trainer.joint.seconds

    def _has_settled(self) -> bool:
        """Whether pictures lie where they will, and are sharp enough to tell."""
        iteration = self.trainer.iteration
        return self.budget.done(iteration) >= _SETTLED and iteration >= _LEAST_SEEN * len(self.trainer.views)

    def save(self, folder: Path, whose: str) -> None:
        """Write a checkpoint."""
        save_checkpoint(folder, self.trainer.iteration, self.state(), whose)
        self.saved = time.monotonic()

    def result(self, keep: Callable[[bytes], None] = nowhere) -> Trained:
        """The best file of what was learnt so far.

        Args:
            keep: called with a file of the same scene, somewhat larger, before what takes longest begins.
        """
        trainer, budget = self.trainer, self.budget
        trainer.finish()
        count = trainer.state.plan.count
        looked = evenly(self.held_out, budget.looks(count, len(self.held_out)))
        found = [self._quality(looked, layer) for layer in range(count)]
        displaced, missing = self._displacement(), self._missing(found[-1][0])
        held_out = tuple(view.camera.name for view in self.held_out)
        scene = trainer.quantise({"held_out": list(held_out), "converged": not missing})
        opening = middle_camera([view.camera for view in trainer.views])
        scene = replace(scene, streaming=build_streaming_block(scene, reconstruct_anchors(scene), opening))
        data = smallest_file(scene, trainer.joint, keep, lambda: not budget.may_train_predictors())
        layers = tuple(LayerQuality(size, *each) for size, each in zip(layer_sizes(data), found, strict=True))
        if missing:
            warnings.warn(f"not converged: {missing}", InputWarning, stacklevel=2)
        return Trained(data, layers, trainer.iteration, budget.spent, displaced, held_out, not missing)

    def _quality(self, looked: Sequence[View], layer: int | None) -> tuple[float, float]:
        trainer = self.trainer
        with self.budget.note("picture", len(looked)):
            return quality(trainer.state, looked, layer, trainer.background)

    def _missing(self, psnr: float) -> str:
        """Why a longer run would do better, empty where none would by much."""
        trainer = self.trainer
        seen = trainer.iteration / len(trainer.views)
        if seen < _LEAST_SEEN or trainer.iteration < _LEAST_ITERATIONS:
            each = f"{plural(trainer.iteration, 'iteration')} saw each photo {seen:.1f} times"
            return f"{each}; give more time, or a lower --resolution"
        if psnr < self.best - _FALL:
            return f"the end has {psnr:.2f} dB, {self.best - psnr:.2f} less than before; give more time"
        return ""

    def _displacement(self) -> float:
        """How far pictures lie beside the photos learnt from."""
        state, views, background = self.trainer.state, self.trainer.views, self.trainer.background
        looked = views[:: -(-len(views) // LOOKS)]
        device = state.device
        return displacement((draw(state, view.camera, None, background), view.photo(device)) for view in looked)


def evenly(views: Sequence[View], count: int) -> list[View]:
    """At most `count` of some views, spread over them."""
    return [views[place * len(views) // count] for place in range(count)] if count < len(views) else list(views)


def layer_sizes(data: bytes) -> list[int]:
    """Bytes of a file cut after each of its layers."""
    return [layer.end_offset for layer in Container(BytesSource(data)).header.layers]


def train(
    capture: Capture,
    options: TrainOptions | None = None,
    folder: Path | None = None,
    report: Report = silent,
    stop: Stop = never,
    leave: Stop = never,
) -> Trained:
    """Learn a scene from photos, and write it.

    Args:
        options: None for the defaults.
        folder: for checkpoints, log and plot; a run that was interrupted or stopped goes on from the last checkpoint
            there. Who has the file safe discards them (`run_folder.discard_checkpoints`). None keeps nothing.
        report: called after every iteration.
        stop: asked after every iteration whether to end now with the best file so far.
        leave: asked as often, where there is a folder, whether to leave off: with a checkpoint, and without a file.

    Raises:
        InvalidInput: ``input-options``, also where memory or disk is too small, ``input-dependency``,
            ``input-checkpoint``.
        Suspended: `leave` said yes; the next call goes on.
    """
    options = (options or TrainOptions()).resolve()
    check_room(capture, folder)
    with reproducible(run_device(options.device)):
        run = Run(capture, options, report, folder)
        if folder is not None:
            return _train_in(folder, run, identity(capture, options), stop, leave)
        while run.step() and not stop():
            if run.check_due():
                run.check()
        return run.result()


def _train_in(folder: Path, run: Run, whose: str, stop: Stop, leave: Stop) -> Trained:
    """The result of a run that keeps checkpoints and a log in a folder, and continues from those it finds there."""
    checkpoint = load_checkpoint(folder, whose)
    if checkpoint is not None:
        run.load(checkpoint[1])
    with RunLog(folder, run.trainer.iteration, [view.camera.name for view in run.held_out]) as log:
        while run.step() and not stop():
            if run.check_due():
                figures = run.check()
                log.note(run.progress(), **figures)
            if time.monotonic() - run.saved > _SAVE_SECONDS:
                run.save(folder, whose)
            if leave():
                run.save(folder, whose)
                raise Suspended(run.progress())
        run.save(folder, whose)
        run.report(replace(run.progress(), phase=FINISHING))
        trained = run.result(partial(save_draft, folder))
        ended = replace(run.progress(), psnr=trained.layers[-1].psnr, bytes=len(trained.data), phase="written")
        log.note(ended, layers=str([(layer.bytes, round(layer.psnr, 3)) for layer in trained.layers]))
    return trained
