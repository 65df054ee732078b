"""A client of streamed SOG: which files it asks for, and when."""

from __future__ import annotations

from collections.abc import Hashable

from benchmarks.streaming_network import Flow, Link
from benchmarks.streaming_rivals import Levels
from scarfmt.streaming.view import Camera

NOTHING = -1


class LevelStream:
    """Loads the coarsest level, shows it, and then loads the finest, which replaces it.

    That is what SuperSplat's viewer (PlayCanvas engine 2.22) does with a scene within its budget of Gaussians: only the
    coarsest level is in range until it is there, and then the engine goes for the finest at once. Of each it asks for
    meta.json first, and then for all pictures together.

    Args:
        levels: the scene.
    """

    def __init__(self, levels: Levels) -> None:
        self._levels = levels
        self._level = NOTHING
        self._left = 1
        self._begun = False
        self._wanted = [levels.index_size]
        self.asked: list[float] = []
        self.shown: list[tuple[float, Hashable]] = [(0.0, NOTHING)]
        self.came: list[tuple[float, Hashable, float]] = []

    @property
    def done(self) -> bool:
        """Whether the finest level is there."""
        return self.shown[-1][1] == len(self._levels.files) - 1

    def look(self, now: float, camera: Camera) -> None:
        """Do nothing: a level is one piece."""

    def ask(self, now: float, link: Link) -> None:
        """Everything that is known to be needed of the level in hand."""
        for size in self._wanted:
            link.ask(now, self._level, size)
            self.asked.append(now)
        self._wanted = []

    def took(self, now: float, flow: Flow, size: float) -> None:
        """A level is shown once all of it has come."""
        if self._level != NOTHING:
            self.came.append((now, None, size))
        if not flow.done:
            return
        self._left -= 1
        if self._left > 0 or self.done:
            return
        if self._level == NOTHING:
            self._next()
        elif not self._begun:
            self._begun, self._wanted = True, list(self._levels.files[self._level][1])
            self._left = len(self._wanted)
        else:
            self.shown.append((now, self._level))
            if not self.done:
                self._next()

    def _next(self) -> None:
        """On to the next finer level: its meta.json first."""
        self._level += 1
        self._begun, self._left = False, 1
        self._wanted = [self._levels.files[self._level][0]]
