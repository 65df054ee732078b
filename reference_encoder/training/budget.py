"""The time of a run: how much of it is over, and what its end will take.

A run ends with predictors, pictures of held-out photos and the file. What these take is told by what coding and
drawing took when last measured, on the machine as busy as it is; predictors get what is left.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager

from reference_encoder.training.options import TrainOptions

_CODINGS = 5.0
"""Times that the scene is coded at the end: for the draft, to record what predictors see, for the file; and read."""
_INDEX_STEPS = 1500.0
"""Steps of the index network at the end."""
_PREDICTORS, _MOST_PREDICTORS = 0.06, 180.0
"""Share of the time that predictors may have at least, with a maximum in seconds."""
_PICTURES = 0.05
"""Largest share of the time for pictures of held-out photos at the end, if that shows two at least."""
_UNKNOWN, _FIRST = 0.2, 0.15
"""Share of the time that is kept as long as nothing is measured; of the run, after which that is done."""
_MARGIN, _MOST = 1.1, 0.5
"""Times what is expected that is kept; the largest share of the time that is kept at all."""
_MEMORY = 0.5
_CHECKS, _BETWEEN = 0.03, 60.0
"""Largest share of the time for looks at held-out photos on the way, and seconds between two at least."""


class Budget:
    """A run's iterations or seconds.

    Args:
        options: with one of `minutes` and `iterations` set.
        reading: seconds spent on the capture.

    Attributes:
        seconds: all of them; infinite for a run by iterations.
        reading: seconds in which nothing was learnt yet, with :meth:`begin`.
        before: seconds of training before an interruption.
        costs: seconds that things took when last measured: "coding", "picture", "index", "check".
        pictures, indexed: how many pictures are drawn at the end; whether an index network is trained then.
    """

    def __init__(self, options: TrainOptions, reading: float) -> None:
        self.iterations, self.reading, self.before = options.iterations, reading, 0.0
        self.seconds = math.inf if options.minutes is None else 60 * options.minutes
        self.costs: dict[str, float] = {}
        self.pictures, self.indexed = 0, False
        self._started = time.monotonic()
        self._checked = self._started
        self._done = 0.0

    @property
    def spent(self) -> float:
        """Seconds in all, those before an interruption included."""
        return self.reading + self.trained

    @property
    def trained(self) -> float:
        """Seconds since learning began, those before an interruption included."""
        return self.before + time.monotonic() - self._started

    def begin(self) -> None:
        """Learning begins: the time until now was spent on reading."""
        self.reading += self.trained
        self._started = self._checked = time.monotonic()

    @contextmanager
    def note(self, what: str, count: int = 1) -> Iterator[None]:
        """Note how long each of `count` things takes."""
        before = time.monotonic()
        yield
        found = (time.monotonic() - before) / max(count, 1)
        self.costs[what] = _MEMORY * self.costs.get(what, found) + (1 - _MEMORY) * found

    def done(self, iteration: int) -> float:
        """Fraction of the run, 1 or more when it is over; it never falls."""
        if self.iterations is not None:
            return iteration / self.iterations
        if iteration:  # one at least, whatever the capture took
            self._done = max(self._done, self.trained / max(self.seconds - self.reading - self.estimate_end(), 1e-9))
        return self._done

    def plan(self, iteration: int) -> int:
        """How many iterations it will be."""
        done = self.done(iteration)
        return self.iterations or max(iteration, round(iteration / done) if done > 0 else 0)

    def estimate_end(self) -> float:
        """Seconds that are kept for the end."""
        if "coding" not in self.costs:
            return _UNKNOWN * self.seconds
        predictors = min(_PREDICTORS * self.seconds, _MOST_PREDICTORS)
        return min(self._fixed(_CODINGS) + predictors, _MOST * self.seconds)

    def may_train_predictors(self) -> bool:
        """Whether there is still time for more than what has to follow them."""
        return self.spent + self._fixed(_CODINGS / 2) < self.seconds

    def looks(self, layers: int, available: int) -> int:
        """How many of the held-out photos are looked at in each layer at the end."""
        one = self.costs.get("picture", 0.0) * layers
        return available if one == 0 else int(min(max(_PICTURES * self.seconds / one, 2), available))

    def check_due(self, iteration: int, every: int) -> bool:
        """Whether it is time to look at held-out photos: after so many iterations, or as far as the time allows."""
        if self.iterations is not None:
            return iteration % every == 0
        if "check" not in self.costs:
            return self._done >= _FIRST
        return time.monotonic() - self._checked > max(self.costs["check"] / _CHECKS, _BETWEEN)

    @contextmanager
    def checking(self) -> Iterator[None]:
        """A look at held-out photos."""
        with self.note("check"):
            yield
        self._checked = time.monotonic()

    def _fixed(self, codings: float) -> float:
        coding, picture, index = (self.costs.get(name, 0.0) for name in ("coding", "picture", "index"))
        steps = _INDEX_STEPS if self.indexed else 0.0
        return _MARGIN * (codings * coding + self.pictures * picture + steps * index)
