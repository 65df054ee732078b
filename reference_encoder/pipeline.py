"""The pipeline of the encoder: from a scene to the bytes of a file, stage by stage (nothing here is normative).

    stage             hands on    what is decided                                       in
    measured          Profile     nothing: what an error in each value shows            measure, profiles
    attempted         Attempt     at one lambda, what `quality` is predicted to need:
      .problem        Problem     classes, tiles and cells, latent and codewords        profiles, decide, latent
      planned         Plans       nothing: what each step of each class costs, gains    decide/plans.py
      predicted       choices     what each layer shows                                 decide/layering.py
      decide          Decision    steps, contexts, the integers of all channels         decide/decision.py
      .finish         Quantised   all integers of the file                              profiles, decide/assemble.py
    layered           Layering    what each layer shows, by pictures of layers          decide/layering.py
    best_file         Written     which networks the file gets                          networks
    encoded           Encoded     lambda, by pictures of the result after each stage    judge
      streamed                    nothing: what clients are told of tiles and layers    streaming

One currency runs through all of it: lambda, squared picture error per bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from reference_encoder.decide.assemble import Quantised
from reference_encoder.decide.decision import Decision, decide
from reference_encoder.decide.layering import (
    Entry,
    LayerChoice,
    LayerCosts,
    Layering,
    Look,
    best_looking,
    first_picture,
    likely_first,
    predicted,
    predicted_after,
)
from reference_encoder.decide.plans import Plans, layer_costs, planned
from reference_encoder.decide.problem import Problem
from reference_encoder.judge.calibrate import Search
from reference_encoder.judge.quality import Quality
from reference_encoder.judge.rough import rough
from reference_encoder.judge.tries import Tries
from reference_encoder.judge.views import Sight
from reference_encoder.networks.decode_time import index_network_ns, networks_ns
from reference_encoder.networks.file_costs import index_bytes, latent_cost, mechanisms, within_limits
from reference_encoder.options import EFFORTS, EncodeOptions
from reference_encoder.profiles.explicit import ExplicitProfile
from reference_encoder.profiles.profile import Profile
from reference_encoder.streaming.told import streamed
from reference_encoder.tuning import FIRST_CAP_DB, PROMISED_DB, TOLERANCE_DB, WORST_BELOW_DB
from scarfmt.coding.decoder_model import MECHANISMS
from scarfmt.coding.tile import TileContent
from scarfmt.coding.writer import QuantisedScene, Report, silent, write_scene
from scarfmt.engines import best_engine
from scarfmt.errors import InvalidInput, missing_package
from scarfmt.scene.gaussians import AnchorModel, GaussianScene
from scarfmt.tools.annotate import annotated

if TYPE_CHECKING:  # needs torch
    from reference_encoder.networks.candidates import Learned

    Learner = Callable[[QuantisedScene, float], Learned | None]


@dataclass(frozen=True)
class Attempt:
    """The result of one lambda.

    Attributes:
        problem: what there was to decide.
        plans: what it costs.
        decision: what was decided.
        plain: all integers, before any network.
    """

    problem: Problem
    plans: Plans
    decision: Decision
    plain: Quantised


@dataclass(frozen=True)
class Laid:
    """A problem and what its layers hold.

    Attributes:
        problem: with those classes split of which the first layer shows a part.
        plans: what it costs.
        choices: for all layers.
        first: the first of them before any class was split.
    """

    problem: Problem
    plans: Plans
    choices: Sequence[LayerChoice]
    first: LayerChoice


@dataclass(frozen=True)
class Written:
    """A file, all integers of it, and what the networks in it save and cost (`file_costs.mechanisms`)."""

    data: bytes
    scene: QuantisedScene
    mechanisms: Mapping[str, Any] = field(default_factory=dict)

    @property
    def has_networks(self) -> bool:
        """Whether any predictor or index network is in it."""
        return self.scene.network is not None or any(self.scene.predictors.values())


class Encoded(bytes):
    """The bytes of a file, and how good its pictures are.

    Attributes:
        quality: of the last layer, from views that played no part in encoding.
    """

    quality: Quality

    @classmethod
    def of(cls, data: bytes, quality: Quality) -> Encoded:
        """Bytes with what is known of them."""
        made = cls(data)
        made.quality = quality
        return made


def encoded(scene: GaussianScene | AnchorModel, options: EncodeOptions, report: Report = silent) -> Encoded:
    """A file for `scene`, all stages one after another, and how good its pictures are.

    What comes after the first corrections of lambda moves pictures a little: layers by looks, codewords chosen again.
    So each stage ends by looking again, the last at what the finished file holds.

    Raises:
        InvalidInput: ``input-dependency`` where torch is needed and missing, ``input-anchors``.
    """
    check_torch(scene, options)
    loop = Loop(measured(scene, options, report))
    written = loop.written(loop.laid_out())
    quality = loop.reported(written)
    networks = {MECHANISMS: written.mechanisms} if written.mechanisms else {}
    metadata = {"quality": quality.figures(), **networks, **written.scene.metadata}
    loop.profile.report("viewpoints", 0.0)
    told = replace(options, frame=loop.profile.options.frame)
    return Encoded.of(streamed(annotated(written.data, metadata), written.scene, told), quality)


def quantised(scene: GaussianScene | AnchorModel, options: EncodeOptions, report: Report = silent) -> Quantised:
    """Everything that is decided about a scene before any network."""
    check_torch(scene, options)
    return Loop(measured(scene, options, report)).laid_out().plain


def check_torch(scene: GaussianScene | AnchorModel, options: EncodeOptions) -> None:
    """Check that torch is there if `options` or the scene need it: before the work, not after it.

    Raises:
        InvalidInput: ``input-dependency``, and what does without.
    """
    anchors = isinstance(scene, AnchorModel)
    if not (anchors or options.needs_torch) or find_spec("torch") is not None:
        return
    missing = missing_package("torch", "neural")
    if anchors:
        advice = "the networks of an anchor model cannot be measured without"
    elif options.latent == "learned":
        advice = "or leave out --latent learned"
    else:
        advice = "or use --effort 1 or --decode-budget 0, which train no networks"
    raise InvalidInput(missing.refusal, f"{missing.message}; {advice}")


def measured(scene: GaussianScene | AnchorModel, options: EncodeOptions, report: Report) -> Profile[Any]:
    """The scene, and what an error in each of its values shows."""
    if isinstance(scene, AnchorModel):
        from reference_encoder.profiles.anchors import AnchorProfile  # needs torch

        return AnchorProfile.measured(scene, options, report)
    return ExplicitProfile.measured(scene, options, report)


def attempted(profile: Profile[Any], quality: float, layering: Layering | None = None) -> Attempt:
    """The decision at the lambda predicted to give `quality` dB; layers as predicted, or as in `layering`."""
    return decided(profile, profile.problem(quality), layering)


def decided(profile: Profile[Any], problem: Problem, layering: Layering | None) -> Attempt:
    """The decision about a problem; layers as predicted, or as in `layering`."""
    profile.report("allocate", 0.0)
    classes = problem.classes.count
    if layering is not None:
        problem = layering.split(problem)
    plans = planned(problem)
    costs = layer_costs(problem, plans)
    if layering is not None:
        choices = layering.choices(costs, classes)
    else:
        choices = predicted(costs, problem.budget.base_share, profile.options.layers)
    return _attempt(profile, Laid(problem, plans, choices, choices[0]))


def _attempt(profile: Profile[Any], laid: Laid) -> Attempt:
    decision = decide(laid.problem, laid.plans, laid.choices)
    profile.report("allocate", 1.0)
    return Attempt(laid.problem, laid.plans, decision, profile.finish(laid.problem, decision))


def layered(profile: Profile[Any], problem: Problem, plans: Plans) -> Laid:
    """The content of layers: a first layer without holes, then others. It is chosen from pictures, or by rule.

    Args:
        problem, plans: no class is split.
    """
    options, share, costs = profile.options, problem.budget.base_share, layer_costs(problem, plans)
    if not EFFORTS[options.effort].looks_at_layers:
        laid = layered_by_rule(problem, plans, options.layers)
    else:
        first = first_picture(costs, _look(profile, problem, plans, FIRST_CAP_DB), options.asked_db, share)
        problem, plans, costs = _split(problem, plans, first)
        look = _look(profile, problem, plans, options.asked_db)
        laid = Laid(problem, plans, best_looking(costs, look, _whole(first), options.layers), first)
    profile.report("layers", 1.0)
    return laid


def layered_by_rule(problem: Problem, plans: Plans, layers: int) -> Laid:
    """The content of layers without a look at pictures, for at least two layers. For the arguments see
    :func:`layered`."""
    first = likely_first(layer_costs(problem, plans), problem.budget.base_share)
    problem, plans, costs = _split(problem, plans, first)
    return Laid(problem, plans, predicted_after(_whole(first), costs, layers), first)


def _split(problem: Problem, plans: Plans, first: LayerChoice) -> tuple[Problem, Plans, LayerCosts]:
    """With those classes split of which the first layer shows a part."""
    if min(first.parts) < 1:
        problem = problem.split(first.parts)
        plans = planned(problem)
    return problem, plans, layer_costs(problem, plans)


def _whole(first: LayerChoice) -> LayerChoice:
    """The first layer once the parts of classes that it shows are classes of their own."""
    return replace(first, parts=(1.0,) * first.shown)


def _look(profile: Profile[Any], problem: Problem, plans: Plans, most: float) -> Look:
    """Looks at layers, each view counting as at most `most` dB."""

    def decibels(entries: Sequence[Entry], parts: Sequence[float]) -> float:
        profile.report("layers", 0.0)
        assert profile.looks is not None
        return profile.looks.psnr_db(rough(problem, plans, entries, parts), most)

    return decibels


class Loop:
    """The stages after measuring, each repeated until pictures are as good as asked.

    Attributes:
        profile: the scene.
        search: for the quality to predict for.
        layering: what layers hold by their looks, once that is known.
    """

    def __init__(self, profile: Profile[Any]) -> None:
        options = profile.options
        self.profile = profile
        start = options.quality if options.worst is None else options.worst + WORST_BELOW_DB
        self.search = Search(options.asked_db, allowed_corrections(options), start)
        self.layering: Layering | None = None
        self._judged: tuple[Sequence[TileContent], float] | None = None

    @cached_property
    def judge(self) -> Tries[Any]:
        """Pictures of the source, drawn when they are first wanted."""
        return Tries(self.profile.judge(Sight.LOOP), self.profile.options.worst is None)

    def attempt(self, aim: float) -> Attempt:
        """The decision for a target, dB. Layers that follow the rule are laid out anew for each target."""
        problem = self.profile.problem(aim)
        if self._has_layers and not EFFORTS[self.profile.options.effort].looks_at_layers:
            return _attempt(self.profile, layered(self.profile, problem, planned(problem)))
        return decided(self.profile, problem, self.layering)

    @property
    def _has_layers(self) -> bool:
        return self.profile.shows_layers and self.profile.options.layers > 1

    def found(self, scene: QuantisedScene) -> float:
        """The figure of a file that is compared with the target, dB. Views that were judged last are not drawn
        again."""
        if self._judged is None or self._judged[0] is not scene.contents:
            self.profile.report("quality", 0.0)
            self._judged = scene.contents, self.judge.found_db(self.profile.finished(scene))
        return self._judged[1]

    def laid_out(self) -> Attempt:
        """The attempt before any network that is as good as asked, layers in place."""
        later = int(self._has_layers and EFFORTS[self.profile.options.effort].looks_at_layers)
        networks = int(self.profile.options.trains_networks)
        attempt = self._settled(self.attempt(self.search.aim), later + networks)
        if later:
            laid = layered(self.profile, attempt.problem, attempt.plans)
            self.layering = Layering.of(attempt.problem.classes.count, laid.first, laid.choices)
            attempt = self._settled(_attempt(self.profile, laid), networks)
        return attempt

    def _settled(self, attempt: Attempt, spare: int = 0) -> Attempt:
        return self.search.settled(attempt, self.attempt, lambda tried: self.found(tried.plain.scene), spare)

    def written(self, attempt: Attempt) -> Written:
        """The file, written again while codewords that were chosen again leave it off what was asked."""
        options, report = self.profile.options, self.profile.report

        def write(made: Attempt) -> Written:
            return best_file(made.plain, options, report)

        written = write(attempt)
        if not options.trains_networks:
            return written
        # Networks are what takes longest: they are trained again for what was promised, not for less.
        self.search.left = min(self.search.left, 1)
        return self.search.settled(
            written,
            lambda aim: write(self.attempt(aim)),
            lambda made: self.found(made.scene),
            tolerance=PROMISED_DB if written.has_networks else TOLERANCE_DB,
        )

    def reported(self, written: Written) -> Quality:
        """How good pictures of a file are, from views that nothing was decided by."""
        self.profile.report("quality", 0.0)
        return self.profile.judge(Sight.REPORT).quality(self.profile.finished(written.scene))


def allowed_corrections(options: EncodeOptions) -> int:
    """How often lambda may be corrected: as asked for, or by effort."""
    return EFFORTS[options.effort].corrections if options.corrections is None else options.corrections


def best_file(
    plain: Quantised, options: EncodeOptions, report: Report = silent, learner: Learner | None = None
) -> Written:
    """The file found whose bytes, and those transferred while its networks decode, are fewest.

    Up to three are written, and the first is the one without networks. Predictors of channel values come first, each
    only if it saves more than it takes; then the index network. With it, codewords are chosen again at its prices, if
    there are targets to choose by. The network stays if what it codes, its own blocks and its time cost less than
    indices under static tables, by bits and error together; and if then the file as a whole is not better, the static
    one is returned.

    Args:
        plain: all integers, under static tables only.
        options: `bits_per_ns` says what time is worth, `decode_budget` bounds what is tried; of `effort`, 1 tries
            nothing, and 3 several networks.
        report: told (stage, fraction done).
        learner: trains the index network, given a scene and the nanoseconds that a decoder may spend on it; without,
            one is trained from nothing.
    """
    static = _written(plain.scene, report)
    if not options.trains_networks:
        return static
    from reference_encoder.networks.affordable import most_index_ns
    from reference_encoder.networks.candidates import affordable_predictors, with_index_network, with_rounds

    index_bits = 8.0 * index_bytes(static.data)
    predicted_scene = affordable_predictors(plain.scene, options, report)
    most_ns = most_index_ns(index_bits, options)
    learner = learner or (lambda scene, most_ns: with_index_network(scene, options, report, most_ns))
    learned = learner(predicted_scene or plain.scene, most_ns)
    time_bits = 0.0 if learned is None else options.bits_per_ns * index_network_ns(learned.scene)
    if learned is not None and learned.bits + time_bits < index_bits:
        if plain.targets is not None:
            learned = with_rounds(learned, plain.targets, options, report)
        neural = _written(learned.scene, report)
        if latent_cost(replace(plain, scene=neural.scene), neural.data, time_bits) < latent_cost(plain, static.data):
            return _better(static, neural, options)
    return static if predicted_scene is None else _better(static, _written(predicted_scene, report), options)


def _written(scene: QuantisedScene, report: Report) -> Written:
    return Written(write_scene(scene, report, best_engine()), scene)


def _better(static: Written, neural: Written, options: EncodeOptions) -> Written:
    """The file with networks if its bytes and its time together are less and readers take it."""
    cost = 8 * len(neural.data) + options.bits_per_ns * networks_ns(neural.scene)
    if cost >= 8 * len(static.data) or not within_limits(neural.data):
        return static
    return replace(neural, mechanisms=mechanisms(static.data, neural.scene, neural.data))
