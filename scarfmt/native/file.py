"""The models and tiles of one file in the C library."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Mapping, Sequence
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from scarfmt.arrays import I64
from scarfmt.container.directory import Tile
from scarfmt.container.header import HeaderFields
from scarfmt.container.registries import Stream
from scarfmt.native.binding import SceneRows
from scarfmt.scene.gaussians import GaussianScene


class What(IntEnum):
    """Numbers of a tile, as ``scar.h`` names them."""

    CODES = 0
    CLASSES = 1
    INTEGERS = 2
    INDICES = 3
    SLOTS = 4
    POSITIONS = 5
    VALUES = 6


_CHANNELS, _STREAM, _COMPONENTS, _STAGES = 0, 1, 2, 4
"""Numbers of the models, as ``scar.h`` names them."""


class NativeFile:
    """The models of a file's first layers, and the tiles read with them. Threads may share one.

    Args:
        layers: how many.
        blocks: (layer, kind) -> payload of the model blocks of these layers, checksums checked.

    Attributes:
        refusal: the id of the rule that a model breaks, None where all are sound. No tile can be read then.
    """

    def __init__(
        self,
        library: ctypes.CDLL,
        fields: HeaderFields,
        file_length: int,
        layers: int,
        blocks: Mapping[tuple[int, int], bytes],
    ) -> None:
        self._layers, self._own = layers, threading.local()
        numbers = int(fields.profile), fields.sh_degree, fields.slots, fields.lattice_bits, file_length
        self._scar = _Scar(library, library.scar_open(*numbers, *fields.origin, fields.voxel))
        for (layer, kind), payload in blocks.items():
            library.scar_block(self._scar.at, layer, kind, payload, len(payload))
        self.refusal = self._scar.refusal()
        if self.refusal is None and library.scar_models(self._scar.at, 1, layers) != 0:
            self.refusal = self._scar.refusal()

    def work(self, tiles: I64, anchors: int, splits: int) -> float:
        """The work that the file declares (SPEC §13.2), for (layers,) tiles that have anchors after each layer, anchors
        and splits of nodes; -1 where networks code symbols."""
        counts = np.ascontiguousarray(tiles, np.int64)
        return float(self._scar.calls.scar_work(self._scar.at, counts.ctypes.data, anchors, splits))

    @cached_property
    def channels(self) -> list[tuple[Stream, int]]:
        """Stream and components of each channel."""
        of = range(self._number(_CHANNELS))
        return [(Stream(self._number(_STREAM, c)), self._number(_COMPONENTS, c)) for c in of]

    @cached_property
    def stages(self) -> int:
        """Columns of indices."""
        return self._number(_STAGES)

    def _number(self, what: int, which: int = 0) -> int:
        return int(self._scar.calls.scar_model_number(self._scar.at, what, which))

    def tile(
        self, place: Tile, blocks: Sequence[tuple[int, bytes | None]], streams: frozenset[Stream]
    ) -> NativeTile | None:
        """A tile after the last layer; None where it breaks a rule.

        Args:
            blocks: per layer, the anchors that appear and the block, if there is one.
        """
        scar = getattr(self._own, "scar", None)
        if scar is None:
            scar = self._own.scar = _Scar(self._scar.calls, self._scar.calls.scar_share(self._scar.at), self._scar)
        tile = scar.calls.scar_tile(scar.at, place.depth, place.shift, place.prefix & 0xFFFFFFFF, place.prefix >> 32)
        bits = sum(1 << int(stream) for stream in streams)
        for count, payload in blocks:
            if not tile:
                return None
            data = b"" if payload is None else payload
            tile = scar.calls.scar_advance(scar.at, tile, data, len(data), count, bits)
        return NativeTile(self, scar, tile) if tile else None


class NativeTile:
    """A tile after a layer. It belongs to the thread that read it.

    Attributes:
        file: that it is of.
    """

    def __init__(self, file: NativeFile, scar: _Scar, at: int) -> None:
        self.file, self._scar, self._at = file, scar, at
        self._count = int(scar.calls.scar_tile_count(at))

    def __len__(self) -> int:
        return self._count

    def __del__(self) -> None:
        self._scar.calls.scar_release(self._at)

    def put_numbers(self, what: What, dtype: DTypeLike, out: NDArray[Any], channel: int = 0) -> None:
        """Fill `out`, of the shape that ``scar.h`` gives, with some numbers of the tile; `dtype` is theirs there.

        Raises:
            MemoryError: there is no room for them.
        """
        if out.size:
            at = self._scar.calls.scar_values(self._scar.at, self._at, int(what), channel)
            if not at:
                raise MemoryError(f"no room for {what.name}")
            there = (ctypes.c_char * (out.size * np.dtype(dtype).itemsize)).from_address(at)
            out[...] = np.frombuffer(memoryview(there), dtype).reshape(out.shape)

    def put(self, out: GaussianScene) -> None:
        """Fill in a scene of as many Gaussians, whose arrays are rows of larger ones (explicit profile).

        Raises:
            MemoryError: there is no room to do so.
        """
        arrays = out.positions, out.log_scales, out.rotations, out.opacity_logits, out.sh
        if self._count and self._scar.calls.scar_scene(
            self._scar.at, self._at, ctypes.byref(SceneRows(*(array.ctypes.data for array in arrays)))
        ):
            raise MemoryError("no room for a tile's values")


class _Scar:
    """A Scar of ``scar.h``, closed when nothing holds it; `owner` is that whose models it shares."""

    def __init__(self, library: ctypes.CDLL, at: int | None, owner: _Scar | None = None) -> None:
        if not at:
            raise MemoryError("no room for a decoder")
        self.calls, self.at, self._owner = library, at, owner

    def __del__(self) -> None:
        if hasattr(self, "at"):
            self.calls.scar_close(self.at)

    def refusal(self) -> str | None:
        """The id of the refusal that ended the last call."""
        found = self.calls.scar_refusal(self.at)
        return None if found is None else found.decode()
