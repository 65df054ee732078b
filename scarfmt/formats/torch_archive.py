"""Tensors in the files that `torch.save` and `torch.jit.save` write, without torch and without running what they hold.

Both are ZIP archives: `data.pkl`, a pickle that says how values nest, and `data/KEY`, the bytes of a tensor's storage.
The pickle is read by a machine that knows only the opcodes torch writes. It calls nothing: a class, whatever its name,
is an empty dictionary for attributes, and the only function is the one that makes a tensor of a storage.
"""

from __future__ import annotations

import math
import pickletools
from collections.abc import Callable, Iterator
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from scarfmt.formats.source import Archive, Source, member_names, open_archive

_TYPES = {"FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2"}
_MAX_PICKLE = 1 << 20
"""Bytes of a pickle: that of three networks has less than 2^12, that of a whole training state less than 2^16."""
_MAX_NAME, _MAX_NESTING, _MAX_DIMENSIONS = 256, 32, 8
_MAX_ARGUMENTS = 16
"""Of a call: torch writes up to 7."""
_MAX_MERGED = 1 << 20
"""Attributes that objects of a pickle take over together, from states that may be shared."""
_LARGE = 1 << 53
"""No number of a pickle is as large; larger ones could take long to multiply, and many of them have one hash."""
_FAILURES = (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError, UnicodeDecodeError)
_TENSOR, _PARAMETER = "torch._utils _rebuild_tensor_v2", "torch._utils _rebuild_parameter"
_MARK = object()


class _Global:
    """A class or function of the pickle, by name."""

    def __init__(self, name: str):
        self.name = name


def tensors(source: Source) -> dict[str, NDArray[np.floating]]:
    """All tensors of floats of a file, by the names that lead to them, joined by dots: ``mlp.0.weight``.

    Raises:
        InvalidInput: ``input-corrupt``: it is no such archive, is damaged, or holds what these do not.
        LimitExceeded: ``input-limit``.
    """
    pickled = [name for name in member_names(source) if name.endswith("/data.pkl") and name.count("/") == 1]
    if len(pickled) != 1:
        raise source.corrupt("not a file of torch.save or torch.jit.save (a ZIP archive with one data.pkl)")
    folder = pickled[0].removesuffix("data.pkl")
    with open_archive(source) as archive:
        if archive.members[pickled[0]].file_size > _MAX_PICKLE:
            raise source.corrupt(f"a pickle of over {_MAX_PICKLE} bytes", field=pickled[0])
        if f"{folder}byteorder" in archive.members and archive.read(f"{folder}byteorder") != b"little":
            raise source.corrupt("saved by a machine of another byte order", field="byteorder")
        storages: dict[str, NDArray[np.floating]] = {}

        def storage(kind: object, key: object, count: object) -> NDArray[np.floating] | None:
            return _storage(archive, folder, storages, kind, key, count)

        try:
            return dict(_leaves(_Machine(storage).run(archive.read(pickled[0])), "", 0, set()))
        except _FAILURES as error:
            if hasattr(error, "refusal"):
                raise
            raise source.corrupt(f"a pickle that torch does not write ({error})", field=pickled[0]) from error


def _storage(
    archive: Archive,
    folder: str,
    known: dict[str, NDArray[np.floating]],
    kind: object,
    key: object,
    count: object,
) -> NDArray[np.floating] | None:
    """A storage's numbers, which are read once; None where they are no floats of 2 to 8 bytes, as networks here are."""
    dtype = _TYPES.get(kind.name.rpartition(" ")[2]) if isinstance(kind, _Global) else None
    if dtype is None:
        return None
    if not isinstance(key, str) or not _is_size(count):
        raise ValueError("a storage without a name or a size")
    if key not in known:
        known[key] = np.frombuffer(archive.read(f"{folder}data/{key}"), dtype)
    numbers = known[key]
    if len(numbers) != count:
        raise archive.source.corrupt(f"{len(numbers)} numbers, declared {count}", field=f"data/{key}")
    return numbers


def _is_size(value: object) -> TypeGuard[int]:
    return type(value) is int and 0 <= value < _LARGE


def _tensor(storage: object, offset: object, size: object, stride: object, *_rest: object) -> object:
    """A view of a storage; only of one that is dense and in order, as parameters are. None of no floats."""
    if not isinstance(storage, np.ndarray):
        return None
    if not isinstance(size, tuple) or not isinstance(stride, tuple) or len(size) > _MAX_DIMENSIONS:
        raise ValueError("a tensor without dimensions, or of too many")
    if not _is_size(offset) or not all(map(_is_size, (*size, *stride))):
        raise ValueError("a tensor whose sizes are no numbers")
    count = math.prod(size)
    dense = [math.prod(size[axis + 1 :]) for axis in range(len(size))]
    if any(step != own for step, own, length in zip(stride, dense, size, strict=True) if length > 1):
        raise ValueError("a tensor whose numbers are not in order")
    if offset + count > len(storage):
        raise ValueError("a tensor beyond its storage")
    return storage[offset : offset + count].reshape(size)


def _leaves(value: object, path: str, depth: int, seen: set[int]) -> Iterator[tuple[str, NDArray[np.floating]]]:
    """Tensors and the names that lead to them; of what is there twice, the first."""
    if isinstance(value, np.ndarray):
        yield path, value
    elif isinstance(value, dict) and id(value) not in seen and depth < _MAX_NESTING:
        seen.add(id(value))
        for name, part in value.items():
            if len(f"{name}") <= _MAX_NAME:
                yield from _leaves(part, f"{path}.{name}" if path else f"{name}", depth + 1, seen)


class _Machine:
    """A stack machine for the pickles of torch.

    Args:
        storage: what a storage is, of its type, key and number of elements.
    """

    def __init__(self, storage: Callable[[object, object, object], NDArray[np.floating] | None]):
        self._storage = storage
        self._merged = 0
        self._stack: list[Any] = []
        self._memo: dict[int, Any] = {}

    def run(self, data: bytes) -> object:
        """The value of a pickle.

        Raises:
            ValueError, TypeError, KeyError, IndexError, AttributeError: it is none of torch.
        """
        for opcode, argument, _ in pickletools.genops(data):
            if opcode.name == "STOP":
                break
            self._do(opcode.name, argument)
        return self._stack.pop()

    def _do(self, name: str, argument: Any) -> None:
        stack = self._stack
        match name:
            case "PROTO" | "FRAME":
                pass
            case "MARK":
                stack.append(_MARK)
            case "NONE" | "NEWTRUE" | "NEWFALSE":
                stack.append({"NONE": None, "NEWTRUE": True, "NEWFALSE": False}[name])
            case "BINUNICODE" | "SHORT_BINUNICODE" | "BININT" | "BININT1" | "BININT2" | "LONG1" | "BINFLOAT":
                stack.append(argument)
            case "GLOBAL":
                stack.append(_Global(argument))
            case "STACK_GLOBAL":
                module, attribute = stack[-2:]
                if not all(isinstance(part, str) and len(part) <= _MAX_NAME for part in (module, attribute)):
                    raise ValueError("a class without a name")
                stack[-2:] = [_Global(f"{module} {attribute}")]
            case "BINPUT" | "LONG_BINPUT":
                self._memo[argument] = stack[-1]
            case "MEMOIZE":
                self._memo[len(self._memo)] = stack[-1]
            case "BINGET" | "LONG_BINGET":
                stack.append(self._memo[argument])
            case _:
                self._gather(name)

    def _gather(self, name: str) -> None:
        """Opcodes that take values off the stack."""
        stack = self._stack
        match name:
            case "EMPTY_TUPLE":
                stack.append(())
            case "EMPTY_DICT":
                stack.append({})
            case "EMPTY_LIST":
                stack.append([])
            case "TUPLE":
                stack.append(tuple(self._since_mark()))
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                count = int(name[-1])
                stack[-count:] = [tuple(stack[-count:])]
            case "APPEND" | "APPENDS":
                values = self._since_mark() if name == "APPENDS" else [stack.pop()]
                stack[-1].extend(values)
            case "SETITEM" | "SETITEMS":
                values = self._since_mark() if name == "SETITEMS" else [stack.pop(-2), stack.pop()]
                pairs = zip(values[::2], values[1::2], strict=True)
                stack[-1].update((name, value) for name, value in pairs if _is_name(name))
            case "BINPERSID":
                _, kind, key, _, count = stack.pop()
                stack.append(self._storage(kind, key, count))
            case "NEWOBJ" | "REDUCE":
                arguments, function = stack.pop(), stack.pop()
                stack.append(_call(function, arguments))
            case "BUILD":
                state = stack.pop()
                if isinstance(state, dict) and "_metadata" not in state:
                    self._merged += len(state)
                    if self._merged > _MAX_MERGED:
                        raise ValueError("objects that share too much")
                    stack[-1].update(state)
            case _:
                raise ValueError(f"opcode {name}")

    def _since_mark(self) -> list[Any]:
        """The values above the last mark of the stack, which are removed together with the mark."""
        start = len(self._stack) - 1
        while self._stack[start] is not _MARK:
            start -= 1
            if start < 0:
                raise ValueError("no mark")
        values = self._stack[start + 1 :]
        del self._stack[start:]
        return values


def _is_name(value: object) -> bool:
    """Whether a key of a dictionary can lead to a tensor: hashing others may take for ever."""
    return isinstance(value, str) or (type(value) is int and abs(value) < _LARGE)


def _call(function: _Global, arguments: tuple[Any, ...]) -> object:
    """The value that a call of the pickle stands for. No code is looked up by name."""
    if len(arguments) > _MAX_ARGUMENTS:
        raise ValueError("a call of too many arguments")
    if function.name == _TENSOR:
        return _tensor(*arguments)
    if function.name == _PARAMETER:
        return arguments[0]
    return {}  # an object of any class: its attributes are put in
