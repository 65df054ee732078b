"""Tiles of many files decoded after different numbers of layers, with few files open and few tiles in memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import groupby
from types import TracebackType
from typing import Self, TypeVar

from reference_decoder.decode import Decoding, reader_for
from reference_decoder.decoded import Decoded
from reference_decoder.request import DecodeRequest
from reference_decoder.scenes.needs import Need, placed_request
from scarfmt.container.source import ByteSource
from scarfmt.counters import Counters, transfers
from scarfmt.scene_index.address import SceneFiles

T = TypeVar("T")
Make = Callable[[int, int, Decoded, Counters | None], T]
"""A function of a file, a number of layers, the decoded part and its counters, whose result is not None."""

MOST_OPEN = 8
"""Files that are open at once."""
WINDOW = 64
"""Tiles that are decoded together where the order is that of need: those of one file and level side by side."""


class _Levels:
    """One open file, its tiles after different numbers of layers.

    Args:
        source: the file.
        request: all but layers and tiles.
        tiles: that will be asked for, by the layers they are wanted after.
        counters: what is computed is added to them.
    """

    def __init__(
        self,
        source: ByteSource,
        request: DecodeRequest,
        tiles: Mapping[int, Sequence[int]],
        counters: Counters | None,
    ) -> None:
        self._reader = reader_for(source, request)
        self._request, self._tiles, self._counters = request, tiles, counters
        self._decodings: dict[int, Decoding] = {}

    def made(self, layers: int, tiles: Sequence[int], make: Callable[[Decoded, Counters | None], T]) -> Iterator[T]:
        """The result for each tile that holds some of what was requested."""
        if layers not in self._decodings:
            asked = replace(self._request, layers=layers, tiles=self._tiles[layers])
            self._decodings[layers] = Decoding(self._reader.twin(), asked, self._counters)
        return self._decodings[layers].made(make, tiles)


class LevelReader:
    """The files of a scene, those last used open: a context manager.

    Args:
        scene: the files.
        request: all but layers and tiles.
        counters: what is read and computed is added to them.
    """

    def __init__(self, scene: SceneFiles, request: DecodeRequest, counters: Counters | None) -> None:
        self._scene, self._request, self._counters = scene, request, counters
        self._tiles: dict[int, dict[int, list[int]]] = {}
        self._open: OrderedDict[int, tuple[_Levels, ExitStack]] = OrderedDict()

    def made(self, needs: Sequence[Need], make: Make[T], *, by_need: bool) -> Iterator[T]:
        """The result of `make` for tiles; tiles without any of what was requested are left out.

        Args:
            needs: tiles, what is needed most first.
            make: called in the thread that decoded.
            by_need: in that order, `WINDOW` tiles at a time; else file by file, level by level.

        Raises:
            InvalidInput, Malformed, Truncated, Unsupported, LimitExceeded: a file is refused.
        """
        for need in needs:
            self._tiles.setdefault(need.file, {}).setdefault(need.layers, []).append(need.tile)
        if not by_need:
            yield from (one for _, one in self._grouped(sorted(needs, key=_place), make))
            return
        for start in range(0, len(needs), WINDOW):
            window = needs[start : start + WINDOW]
            found = dict(self._grouped(sorted(window, key=_place), make))
            yield from (found[need.file, need.tile] for need in window if (need.file, need.tile) in found)

    def _grouped(self, needs: Sequence[Need], make: Make[T]) -> Iterator[tuple[tuple[int, int], T]]:
        for (file, layers), group in groupby(needs, key=lambda need: (need.file, need.layers)):

            def act(
                part: Decoded, own: Counters | None, file: int = file, layers: int = layers
            ) -> tuple[tuple[int, int], T]:
                return (file, int(part.tiles[0])), make(file, layers, part, own)

            levels = self._levels(file)
            with self._scene.named(file):
                yield from levels.made(layers, [need.tile for need in group], act)

    def _levels(self, file: int) -> _Levels:
        if file not in self._open:
            if len(self._open) >= MOST_OPEN:
                _, (_, oldest) = self._open.popitem(last=False)
                oldest.close()
            self._open[file] = self._opened(file)
        self._open.move_to_end(file)
        return self._open[file][0]

    def _opened(self, file: int) -> tuple[_Levels, ExitStack]:
        asked = placed_request(self._request, self._scene.index.files[file].placement)
        with ExitStack() as stack:
            source = stack.enter_context(self._scene.opened(file, self._counters))
            stack.enter_context(transfers(source, self._counters))
            return _Levels(source, asked, self._tiles[file], self._counters), stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for _, stack in self._open.values():
            stack.close()


def _place(need: Need) -> tuple[int, int, int]:
    return need.file, need.layers, need.tile
