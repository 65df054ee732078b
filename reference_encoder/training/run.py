"""Training: from a capture to the bytes of a file, whatever interrupts it (paper §3; SPEC §5-§8)."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from reference_encoder.judge.reconstruct import reconstruct_anchors
from reference_encoder.opening_view import middle_camera
from reference_encoder.streaming_block import build_streaming_block
from reference_encoder.training.anchors import AnchorLattice, SceneNetworks
from reference_encoder.training.capture import Capture, Photo, pixels
from reference_encoder.training.densification import AnchorStatistics
from reference_encoder.training.device import reproducible, run_device
from reference_encoder.training.evaluate import draw, quality
from reference_encoder.training.index_entropy import JointIndexModel
from reference_encoder.training.layers import LayerPlan
from reference_encoder.training.networks.index_training import one_thread
from reference_encoder.training.options import (
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
from reference_encoder.training.pose_check import LOOKS, displacement, warn_of_displacement
from reference_encoder.training.presets import PRESETS, Preset
from reference_encoder.training.quantiser import Quantiser
from reference_encoder.training.rate import Context
from reference_encoder.training.rate_controller import LEAST_PRICE, RateController
from reference_encoder.training.run_folder import RunLog, identity, load_checkpoint, save_checkpoint
from reference_encoder.training.similarity import Target, View
from reference_encoder.training.smallest import smallest_file
from reference_encoder.training.state import State, new_anchors, typical_distance
from reference_encoder.training.trainer import Trainer
from reference_encoder.training.vq_features import VqFeatures
from scarfmt.coding.writer import write_scene
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.render.threads import count_threads

VOXEL = 0.5
"""Edge of a voxel, as a share of the median distance of a starting point to its nearest neighbours."""
EXTENT = 1.1
_LAST_PRICE, _FALL = 0.015, 2.0
"""Loss for a bit a pixel of all photos in the last layer, and how many times more it is in each layer before."""
_CHECK_SECONDS = 120.0
_CHECK_ITERATIONS = 500
_SAVE_SECONDS = 180.0
_SETTLED = 0.25
"""Fraction of the run after which pictures lie where they will."""
_LEAST_HALF = 360
"""Pixels of the longest side of a photo at half its size: what is learnt of smaller ones has to be learnt again."""
_FINISH = 0.1
"""Share of the time that is kept for networks and the file, with a maximum in seconds."""
_MOST_FINISH = 180.0
_MEMORY = 0.98


class Clock:
    """How much of a run is done, by iterations or by time: minus what the file takes at the end.

    Attributes:
        before: seconds spent before an interruption.
    """

    def __init__(self, options: TrainOptions) -> None:
        self.iterations, self.before = options.iterations, 0.0
        whole = 60 * (options.minutes or 0.0)
        self._seconds = whole - min(_FINISH * whole, _MOST_FINISH)
        self._started = time.monotonic()

    @property
    def spent(self) -> float:
        """Seconds, those before an interruption included."""
        return self.before + time.monotonic() - self._started

    def done(self, iteration: int) -> float:
        """Fraction of the run, 1 or more when it is over."""
        if self.iterations is not None:
            return iteration / self.iterations
        return self.spent / self._seconds

    def planned(self, iteration: int) -> int:
        """How many iterations it will be."""
        done = self.done(iteration)
        return self.iterations or max(iteration, round(iteration / done) if done > 0 else 0)


def camera_spacing(eyes: Tensor) -> float:
    """Median distance of (n, 3) cameras, at least one, to the nearest other; 0 of one alone."""
    if len(eyes) < 2:
        return 0.0
    distances = torch.cdist(eyes, eyes)
    distances.fill_diagonal_(torch.inf)
    return float(distances.amin(dim=1).median())


def photos(chosen: tuple[Photo, ...], device: torch.device) -> list[View]:
    """Cameras and what pictures of them are to look like, on a device."""
    return [(photo.camera, Target.of(torch.from_numpy(np.array(pixels(photo))).to(device))) for photo in chosen]


def half_size_views(chosen: tuple[Photo, ...], device: torch.device) -> list[View]:
    """Photos at half their size; none where that would leave too little to see."""
    if max(max(photo.camera.width, photo.camera.height) for photo in chosen) < 2 * _LEAST_HALF:
        return []
    return photos(tuple(replace(photo, camera=photo.camera.scaled(0.5)) for photo in chosen), device)


def make_trainer(capture: Capture, options: TrainOptions) -> Trainer:
    """A run before its first iteration.

    Raises:
        InvalidInput: as of :func:`run_device`.
    """
    device, preset = run_device(options.device), PRESETS[options.preset]
    views = photos(capture.train, device)
    eyes = np.stack([camera.centre for camera, _ in views])
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
        vectors=_vq_features(preset, plan.count, options.seed, device),
    )
    pixel_count = sum(camera.width * camera.height for camera, _ in views)
    price = [options.lambda_ * _LAST_PRICE * _FALL ** (plan.count - 1 - layer) for layer in range(plan.count)]
    wanted = None if options.size is None else [options.size * share for share in plan.shares]
    return Trainer(
        state=state,
        rate_controller=RateController(price, pixel_count, wanted, LEAST_PRICE * options.lambda_),
        views=views,
        small=half_size_views(capture.train, device) or views,
        curriculum=preset.curriculum,
        background=torch.zeros(3, device=device),
        camera_jitter=preset.camera_jitter * camera_spacing(torch.from_numpy(eyes)),
        joint=JointIndexModel(preset.paper, options.seed) if preset.stages else None,
    )


def _vq_features(preset: Preset, layers: int, seed: int, device: torch.device) -> VqFeatures | None:
    """The quantiser of a run on a device, None where latents are sent number by number."""
    if not preset.stages:
        return None
    sizes = preset.dimension, preset.features, preset.stages, preset.codewords
    quantiser = Quantiser(*sizes, linear=not preset.paper, seed=seed)
    by_layer = tuple(max(1, round((layer + 1) * preset.stages / layers)) for layer in range(layers))
    return VqFeatures(quantiser.to(device), by_layer, priced=not preset.paper)


_KEPT = ("threads", "psnr", "bytes", "loss")
"""What a checkpoint has of a run."""


class Run:
    """A training that goes on: its trainer, its clock, what it has found so far.

    A run keeps its number of threads, also over an interruption, whatever else in the process changes it.
    """

    def __init__(self, capture: Capture, options: TrainOptions, report: Report) -> None:
        self.report = report
        self.threads = count_threads()
        with one_thread():  # so that a run is taken up on the same lattice, whatever its number of threads
            self.trainer = make_trainer(capture, options)
        self.clock = Clock(options)
        self.held_out = photos(capture.test, self.trainer.state.device)
        self.psnr: float | None = None
        self.bytes: int | None = None
        self.displacement: float | None = None
        self.loss = float("nan")
        self._checked = self._saved = time.monotonic()

    def state(self) -> dict[str, Any]:
        """For a checkpoint."""
        own = {name: getattr(self, name) for name in _KEPT} | {"spent": self.clock.spent}
        return {"run": own, "trainer": self.trainer.checkpoint()}

    def load(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.trainer.resume(state["trainer"])
        own = dict(state["run"])
        self.clock.before = own.pop("spent")
        vars(self).update(own)

    def step(self) -> bool:
        """One iteration; False when the run is over."""
        done = self.clock.done(self.trainer.iteration)
        if done >= 1:
            return False
        torch.set_num_threads(self.threads)
        loss = self.trainer.step(done)
        first = self.loss != self.loss
        self.loss = loss if first else _MEMORY * self.loss + (1 - _MEMORY) * loss
        self.report(self.progress())
        return True

    def progress(self) -> Progress:
        """The progress of the run."""
        trainer, clock = self.trainer, self.clock
        done = max(clock.done(trainer.iteration), 1e-9)
        return Progress(
            iteration=trainer.iteration,
            iterations=clock.planned(trainer.iteration),
            seconds=clock.spent,
            seconds_left=max(clock.spent * (1 - done) / done, 0.0),
            phase=trainer.phase(done),
            psnr=self.psnr,
            bytes=self.bytes,
            anchors=len(trainer.state.anchors),
            gaussians=trainer.state.open_slots(),
            loss=self.loss,
        )

    def check_due(self) -> bool:
        """Whether it is time to look at held-out photos."""
        if self.clock.iterations is not None:
            return self.trainer.iteration % _CHECK_ITERATIONS == 0
        return time.monotonic() - self._checked > _CHECK_SECONDS

    def check(self) -> dict[str, Any]:
        """Look at held-out photos and at what the writer makes of the values as they are; figures for the log."""
        trainer = self.trainer
        last = trainer.state.plan.count - 1
        self.psnr, _ = quality(trainer.state, self.held_out, last if trainer.noisy else None, trainer.background)
        figures: dict[str, Any] = {"prices": str(trainer.rate_controller.price)}
        if trainer.noisy:
            sizes = layer_sizes(write_scene(trainer.written()))
            self.bytes = sizes[-1]
            figures |= {"estimated": str(trainer.rate_controller.estimate), "written": str(sizes)}
            if len(sizes) == len(trainer.rate_controller.price):
                trainer.rate_controller.record_sizes(sizes)
        if self.displacement is None and self.clock.done(trainer.iteration) >= _SETTLED:
            self.displacement = self._displacement()
            warn_of_displacement(self.displacement)
        figures |= {"displacement": self.displacement}
        if trainer.joint is not None:
            figures |= {"index_bits_an_anchor": trainer.index_bits, "hash_bits": trainer.joint.hash_bits}
        self._checked = time.monotonic()
        return figures

    def save_due(self) -> bool:
        """Whether it is time for a checkpoint."""
        return time.monotonic() - self._saved > _SAVE_SECONDS

    def save(self, folder: Path, whose: str) -> None:
        """Write a checkpoint."""
        save_checkpoint(folder, self.trainer.iteration, self.state(), whose)
        self._saved = time.monotonic()

    def result(self) -> Trained:
        """The best file of what was learnt so far."""
        torch.set_num_threads(self.threads)
        trainer = self.trainer
        trainer.finish()
        scene = trainer.written()
        opening = middle_camera([camera for camera, _ in trainer.views])
        scene = replace(scene, streaming=build_streaming_block(scene, reconstruct_anchors(scene), opening))
        data = smallest_file(scene, trainer.joint)
        sizes = layer_sizes(data)
        layers = tuple(
            LayerQuality(size, *quality(trainer.state, self.held_out, layer, trainer.background))
            for layer, size in enumerate(sizes)
        )
        return Trained(data, layers, trainer.iteration, self.clock.spent, self._displacement())

    def _displacement(self) -> float:
        """How far pictures lie beside the photos learnt from."""
        state, views, background = self.trainer.state, self.trainer.views, self.trainer.background
        looked = views[:: -(-len(views) // LOOKS)]
        return displacement((draw(state, camera, None, background), target) for camera, target in looked)


def layer_sizes(data: bytes) -> list[int]:
    """Bytes of a file cut after each of its layers."""
    return [layer.end_offset for layer in Container.open(BytesSource(data)).header.layers]


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
        capture: photos with cameras, and points to start from.
        options: None for the defaults.
        folder: for checkpoints, log and plot; a run that was interrupted or stopped goes on from the last checkpoint
            there. Who has the file safe discards them (`run_folder.discard_checkpoints`). None keeps nothing.
        report: called after every iteration.
        stop: asked after every iteration whether to end now with the best file so far.
        leave: asked as often, where there is a folder, whether to leave off: with a checkpoint, and without a file.

    Raises:
        InvalidInput: ``input-options``, ``input-dependency``, ``input-checkpoint``.
        Suspended: `leave` said yes; the next call goes on.
    """
    options = (options or TrainOptions()).resolve()
    with reproducible(run_device(options.device)):
        run = Run(capture, options, report)
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
    with RunLog(folder, run.trainer.iteration) as log:
        while run.step() and not stop():
            if run.check_due():
                figures = run.check()
                log.note(run.progress(), **figures)
            if run.save_due():
                run.save(folder, whose)
            if leave():
                run.save(folder, whose)
                raise Suspended(run.progress())
        run.save(folder, whose)
        trained = run.result()
        ended = replace(run.progress(), psnr=trained.layers[-1].psnr, bytes=len(trained.data), phase="written")
        log.note(ended, layers=str([(layer.bytes, round(layer.psnr, 3)) for layer in trained.layers]))
    return trained
