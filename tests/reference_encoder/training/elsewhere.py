"""A device that is not the processor, made of torch's slot for devices of others: stands in for a GPU in tests.

Its tensors say that they are elsewhere, and hold one on the processor that nobody else reaches. Like CUDA it refuses
numbers of both devices in one operation (single numbers aside), numpy, and the processor's generators; unlike CUDA it
refuses indices on the processor, too. What has been placed wrongly anywhere in a training fails on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import torch
from torch import library as registry

try:
    from torch.utils.backend_registration import _setup_privateuseone_for_python_backend
except ImportError:
    pytest.skip("this torch takes no device that is made in Python", allow_module_level=True)

NAME = "elsewhere"
_ATEN = torch.ops.aten
_CROSSING = (_ATEN._to_copy.default, _ATEN.copy_.default)
"""Operations that copy numbers from one device to another."""
_PROCESSOR = torch.Generator
_GENERATORS: dict[int, torch.Generator] = {}
"""Generators of the stand-in device by what torch knows them by. They draw what the processor's generator of that seed
draws."""


class Tensor(torch.Tensor):
    """A tensor of the other device; `held` has its numbers."""

    held: torch.Tensor

    @staticmethod
    def __new__(cls, held: torch.Tensor) -> Tensor:
        shape = {"strides": held.stride(), "storage_offset": held.storage_offset()}
        made = torch.Tensor._make_wrapper_subclass(cls, held.size(), **shape, dtype=held.dtype, device=f"{NAME}:0")
        made.held = held
        return made

    def tolist(self) -> Any:
        """Torch has none for subclasses."""
        return self.held.tolist()

    @classmethod
    def __torch_dispatch__(cls, op: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return _run(op, list(args), kwargs or {})


def _there(device: Any) -> bool:
    return device is not None and torch.device(device).type == NAME


def _mapped(change: Callable[[Any], Any], part: Any) -> Any:
    """A copy of `part` with `change` applied to everything in lists and tuples, however deep."""
    if isinstance(part, list | tuple):
        return type(part)([_mapped(change, inner) for inner in part])
    return change(part)


def _run(op: Any, args: list[Any], kwargs: dict[str, Any]) -> Any:
    """An operation on tensors of the device, by the processor on what they hold."""
    owners: dict[int, Tensor] = {}
    here = op in _CROSSING

    def unwrapped(one: Any) -> Any:
        if isinstance(one, Tensor):
            owners[id(one.held)] = one
            return one.held
        if isinstance(one, torch.Tensor) and one.ndim > 0 and not here:
            raise RuntimeError(f"{op} of tensors elsewhere and one of {tuple(one.shape)} on the processor")
        if isinstance(one, _PROCESSOR) and one._cdata not in _GENERATORS:
            raise RuntimeError(f"{op} elsewhere with a generator of the processor")
        return one

    inner = [_mapped(unwrapped, one) for one in args]
    list_names = {name: _mapped(unwrapped, one) for name, one in kwargs.items()}
    asked = kwargs.get("device")
    if _there(asked):
        list_names["device"] = torch.device("cpu")
    out = op(*inner, **list_names)
    stays = not isinstance(args[0], Tensor) if op is _ATEN.copy_.default else asked is not None and not _there(asked)

    def placed(one: Any) -> Any:
        if stays or not isinstance(one, torch.Tensor):
            return one
        return owners[id(one)] if id(one) in owners else Tensor(one)

    return _mapped(placed, out)


def _registered() -> registry.Library:
    """The device under its name, and what makes its first tensors."""
    _setup_privateuseone_for_python_backend(NAME)
    library = registry.Library("aten", "IMPL")

    def maker(make: Callable[..., torch.Tensor]) -> Callable[..., Tensor]:
        return lambda *args, dtype=None, **_: Tensor(make(*args, dtype=dtype))

    def copied(source: torch.Tensor, to: torch.Tensor, _non_blocking: bool = False) -> torch.Tensor:
        held = [one.held if isinstance(one, Tensor) else one for one in (source, to)]
        held[1].copy_(held[0])
        return to

    makers = {"empty.memory_format": torch.empty, "empty_strided": torch.empty_strided}
    makers |= dict.fromkeys(("arange", "arange.start", "arange.start_step"), torch.arange)
    for name, make in makers.items():
        library.impl(name, maker(make), "PrivateUse1")
    # torch.tensor calls it past all subclasses.
    library.impl("_copy_from", copied, "PrivateUse1")
    return library


_LIBRARY = _registered()
"""Made on import: backward passes find only devices that were there before the first of them."""


@contextmanager
def elsewhere() -> Iterator[torch.device]:
    """The device; as long as this lasts, ``torch.Generator(device)`` makes one of it."""

    class Either(_PROCESSOR):
        """A generator of the requested device."""

        def __new__(cls, device: Any = "cpu") -> torch.Generator:
            if not _there(device):
                return _PROCESSOR(device)
            made = _PROCESSOR()
            _GENERATORS[made._cdata] = made
            return made

    torch.Generator = Either  # type: ignore[misc]
    try:
        yield torch.device(NAME)
    finally:
        torch.Generator = _PROCESSOR  # type: ignore[misc]
        _GENERATORS.clear()
