"""Training: from a capture to the bytes of a file, whatever interrupts it (paper §3; SPEC §5-§8)."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from reference_encoder.decide.assemble import Quantised
from reference_encoder.options import EncodeOptions
from reference_encoder.pipeline import Written, best_file
from reference_encoder.streaming.told import streamed
from reference_encoder.training.alignment import LOOKS, displacement, warn_displaced
from reference_encoder.training.anchors import Frame, SceneNetworks
from reference_encoder.training.capture import Capture, Photo, pixels
from reference_encoder.training.checkpoints import identity, load_checkpoint, save_checkpoint
from reference_encoder.training.curriculum import CURRICULA
from reference_encoder.training.device import reproducible, run_device
from reference_encoder.training.evaluate import Views, drawn, quality
from reference_encoder.training.growth import Statistics
from reference_encoder.training.index_entropy import IndexOptions, JointIndexModel
from reference_encoder.training.layers import LayerPlan
from reference_encoder.training.log import RunLog
from reference_encoder.training.options import (
    LayerQuality,
    LeftOff,
    Progress,
    Report,
    Stop,
    Trained,
    TrainOptions,
    never,
    silent,
)
from reference_encoder.training.price import LEAST_PRICE, Prices
from reference_encoder.training.rate import Context
from reference_encoder.training.recipe import RECIPES, Recipe
from reference_encoder.training.similarity import Target
from reference_encoder.training.state import State, new_anchors, typical_distance
from reference_encoder.training.trainer import Trainer
from scarfmt.coding.writer import QuantisedScene, write_scene
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.engines import best_engine
from scarfmt.errors import InvalidInput

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


@dataclass
class Clock:
    """How much of a run is done, by iterations or by time.

    Attributes:
        iterations: all of them, None where time decides.
        seconds: all of them, None where iterations decide.
        before: seconds spent before an interruption.
    """

    iterations: int | None
    seconds: float | None
    before: float = 0.0

    def __post_init__(self) -> None:
        self._started = time.monotonic()

    @classmethod
    def of(cls, options: TrainOptions) -> Clock:
        """The budget that was asked for, minus the time that the file takes at the end."""
        if options.minutes is None:
            return cls(options.iterations, None)
        whole = 60 * options.minutes
        return cls(None, whole - min(_FINISH * whole, _MOST_FINISH))

    @property
    def spent(self) -> float:
        """Seconds, those before an interruption included."""
        return self.before + time.monotonic() - self._started

    def done(self, iteration: int) -> float:
        """Fraction of the run, 1 or more when it is over."""
        if self.iterations is not None:
            return iteration / self.iterations
        assert self.seconds is not None
        return self.spent / self.seconds

    def planned(self, iteration: int) -> int:
        """How many iterations it will be."""
        done = self.done(iteration)
        return self.iterations or max(iteration, round(iteration / done) if done > 0 else 0)


def spacing(eyes: Tensor) -> float:
    """Median distance of (n, 3) cameras, at least one, to the nearest other; 0 of one alone."""
    if len(eyes) < 2:
        return 0.0
    distances = torch.cdist(eyes, eyes)
    distances.fill_diagonal_(torch.inf)
    return float(distances.amin(dim=1).median())


def photos(chosen: tuple[Photo, ...], device: torch.device) -> Views:
    """Cameras and what pictures of them are to look like, on a device."""
    return [(photo.camera, Target.of(torch.from_numpy(np.array(pixels(photo))).to(device))) for photo in chosen]


def halves(chosen: tuple[Photo, ...], device: torch.device) -> Views:
    """Photos at half their size; none where that would leave too little to see."""
    if max(max(photo.camera.width, photo.camera.height) for photo in chosen) < 2 * _LEAST_HALF:
        return []
    return photos(tuple(replace(photo, camera=photo.camera.scaled(0.5)) for photo in chosen), device)


def begun(capture: Capture, options: TrainOptions, recipe: Recipe | None = None) -> Trainer:
    """A run before its first iteration; `recipe` in place of the preset's.

    Raises:
        InvalidInput: ``input-options`` for what cannot be trained; as of :func:`run_device`.
    """
    device = run_device(options.device)
    recipe = recipe or RECIPES[options.preset]
    if not recipe.stages:
        _check_no_indices(options)
    views = photos(capture.train, device)
    eyes = np.stack([camera.centre for camera, _ in views])
    extent = EXTENT * float(np.linalg.norm(eyes - eyes.mean(axis=0), axis=1).max(initial=1e-6))
    points = torch.from_numpy(capture.points)
    plan = LayerPlan.of(options.layers, options.last_layer)
    frame = Frame.round(points, VOXEL * typical_distance(points))
    anchors = new_anchors(points, frame, recipe.features)
    priced = 6 + (0 if recipe.stages else recipe.features)
    state = State(
        frame=frame.to(device),
        anchors=anchors.to(device),
        networks=SceneNetworks(recipe.features, recipe.features, True, options.seed).to(device),
        context=Context(priced, options.context != "none", options.seed).to(device),
        log_widths=torch.zeros(priced, device=device),
        log_offset_widths=torch.zeros(3, device=device),
        statistics=Statistics.of(len(anchors), device),
        plan=plan,
        generator=torch.Generator().manual_seed(options.seed),
        extent=extent,
        vectors=recipe.vectors(plan.count, options.seed, device),
    )
    pixel_count = sum(camera.width * camera.height for camera, _ in views)
    price = [options.lambda_ * _LAST_PRICE * _FALL ** (plan.count - 1 - layer) for layer in range(plan.count)]
    wanted = None if options.size is None else [options.size * share for share in plan.shares]
    return Trainer(
        state=state,
        prices=Prices(price, pixel_count, wanted, LEAST_PRICE * options.lambda_),
        views=views,
        small=halves(capture.train, device) or views,
        curriculum=CURRICULA[recipe.curriculum],
        ssim_share=options.lambda_ssim,
        background=torch.zeros(3, device=device),
        wander=recipe.wander * spacing(torch.from_numpy(eyes)),
        joint=JointIndexModel(index_options(options)) if recipe.stages else None,
    )


def _check_no_indices(options: TrainOptions) -> None:
    """Refuse what codes the indices of codewords where there are none."""
    fitting = {"context": (None, "decoded", "none"), "entropy": (None, "static")}
    for name, fits in fitting.items():
        said = getattr(options, name)
        if said not in fits:
            message = f"{said} codes indices of codewords, and this preset has none: use it with rvq or paper"
            raise InvalidInput("input-options", message, field=name)


def index_options(options: TrainOptions) -> IndexOptions:
    """The options of the coder of indices."""
    return IndexOptions.named(options.entropy, options.context, options.preset, options.seed)


class Run:
    """A training that goes on: its trainer, its clock, what it has found so far."""

    def __init__(self, capture: Capture, options: TrainOptions, report: Report, recipe: Recipe | None = None) -> None:
        self.options, self.report = options, report
        self.trainer = begun(capture, options, recipe)
        self.clock = Clock.of(options)
        self.held_out = photos(capture.test, self.trainer.state.device)
        self.psnr: float | None = None
        self.bytes: int | None = None
        self.displacement: float | None = None
        self.loss = float("nan")
        self._checked = self._saved = time.monotonic()

    def state(self) -> dict[str, Any]:
        """For a checkpoint."""
        own = {"spent": self.clock.spent, "psnr": self.psnr, "bytes": self.bytes, "loss": self.loss}
        return {"run": own, "trainer": self.trainer.checkpoint()}

    def load(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.trainer.resume(state["trainer"])
        own = state["run"]
        self.clock.before, self.psnr, self.bytes, self.loss = own["spent"], own["psnr"], own["bytes"], own["loss"]

    def step(self) -> bool:
        """One iteration; False when the run is over."""
        done = self.clock.done(self.trainer.iteration)
        if done >= 1:
            return False
        outcome = self.trainer.step(done)
        first = self.loss != self.loss
        self.loss = outcome.loss if first else _MEMORY * self.loss + (1 - _MEMORY) * outcome.loss
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
        figures: dict[str, Any] = {"prices": str(trainer.prices.price)}
        if trainer.noisy:
            sizes = layer_sizes(write_scene(trainer.written(), engine=best_engine()))
            self.bytes = sizes[-1]
            figures |= {"estimated": str(trainer.prices.estimate), "written": str(sizes)}
            if len(sizes) == len(trainer.prices.price):
                trainer.prices.wrote(sizes)
        if self.displacement is None and self.clock.done(trainer.iteration) >= _SETTLED:
            self.displacement = self._displacement()
            warn_displaced(self.displacement)
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
        trainer = self.trainer
        trainer.settle()
        written = smallest(trainer.written(), trainer.joint, self.options.entropy == "static")
        cameras = [camera for camera, _ in trainer.views]
        data = streamed(written.data, written.scene, EncodeOptions(cameras=cameras, only_cameras=True))
        sizes = layer_sizes(data)
        found = [
            quality(trainer.state, self.held_out, layer, trainer.background) for layer in range(len(sizes))
        ]
        layers = tuple(LayerQuality(size, *each) for size, each in zip(sizes, found, strict=True))
        return Trained(data, layers, trainer.iteration, self.clock.spent, self._displacement())

    def _displacement(self) -> float:
        """How far pictures lie beside the photos learnt from."""
        state, views, background = self.trainer.state, self.trainer.views, self.trainer.background
        looked = views[:: -(-len(views) // LOOKS)]
        return displacement((drawn(state, camera, None, background), target) for camera, target in looked)


def smallest(scene: QuantisedScene, joint: JointIndexModel | None, static: bool = False) -> Written:
    """The file of fewest bytes: predictors and networks where they pay in bytes, whatever decoding takes.

    Args:
        joint: what codes indices, if there are any.
        static: tables alone.
    """
    plain, options = Quantised(scene), EncodeOptions(archive=True, decode_budget=0 if static else None)
    return best_file(plain, options) if joint is None else joint.file(plain, options)


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
    recipe: Recipe | None = None,
) -> Trained:
    """Learn a scene from photos, and write it.

    Args:
        capture: photos with cameras, and points to start from.
        options: None for the defaults.
        folder: for checkpoints, log and plot; a run that was interrupted or stopped goes on from the last checkpoint
            there. Who has the file safe discards them (`checkpoints.discard_checkpoints`). None keeps nothing.
        report: told after every iteration.
        stop: asked after every iteration whether to end now with the best file so far.
        leave: asked as often, where there is a folder, whether to leave off: with a checkpoint, and without a file.
        recipe: what to train in place of what the preset stands for; for research.

    Raises:
        InvalidInput: ``input-options``, ``input-dependency``, ``input-checkpoint``.
        LeftOff: `leave` said yes; the next call goes on.
    """
    options = (options or TrainOptions()).settled()
    with reproducible(run_device(options.device)):
        run = Run(capture, options, report, recipe)
        if folder is not None:
            return _kept(run, folder, identity(capture, options, recipe or RECIPES[options.preset]), stop, leave)
        while run.step() and not stop():
            if run.check_due():
                run.check()
        return run.result()


def _kept(run: Run, folder: Path, whose: str, stop: Stop, leave: Stop) -> Trained:
    """The result of a run that keeps checkpoints and a log in a folder, and continues from those it finds there."""
    found = load_checkpoint(folder, whose)
    if found is not None:
        run.load(found[1])
    with RunLog(folder, run.trainer.iteration) as log:
        _loop(run, folder, whose, log, stop, leave)
        trained = run.result()
        ended = replace(run.progress(), psnr=trained.layers[-1].psnr, bytes=len(trained.data), phase="written")
        log.note(ended, layers=str([(layer.bytes, round(layer.psnr, 3)) for layer in trained.layers]))
    return trained


def _loop(run: Run, folder: Path, whose: str, log: RunLog, stop: Stop, leave: Stop) -> None:
    while run.step() and not stop():
        if run.check_due():
            figures = run.check()
            log.note(run.progress(), **figures)
        if run.save_due():
            run.save(folder, whose)
        if leave():
            run.save(folder, whose)
            raise LeftOff(run.progress())
    run.save(folder, whose)
