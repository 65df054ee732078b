"""Backends by name: an engine, or one whose index network torch computes (SPEC §10.5: equal results)."""

from __future__ import annotations

from scarfmt.coding.engine import Engine
from scarfmt.engines import NAMES, best_engine, engine_named
from scarfmt.engines import described as engine_described
from scarfmt.errors import InvalidInput, missing_package
from scarfmt.neural.operations import NUMPY, Operations

TORCH = ("torch", "cuda")
BACKENDS = (*NAMES, *TORCH)
"""The values of `--backend`."""


def backend(name: str) -> Engine:
    """The engine of a backend.

    Args:
        name: "auto", "kernel" or "numpy" as of :func:`scarfmt.engines.engine_named`; "torch", on the CPU, or "cuda":
            the best engine, with torch for the index network.

    Raises:
        InvalidInput: ``input-backend`` for another name, "kernel" where there is none, or "cuda" without such a GPU;
            ``input-dependency`` without torch.
    """
    if name not in BACKENDS:
        raise InvalidInput("input-backend", f"{name!r} is not one of {', '.join(BACKENDS)}", field="backend")
    return engine_named("auto", operations(name)) if name in TORCH else engine_named(name)


def described(name: str) -> str:
    """The engine of a backend, for people; with the reason if it is not the kernel."""
    if name in TORCH:
        return f"{best_engine().name}, index network by torch on {'CUDA' if name == 'cuda' else 'the CPU'}"
    return engine_described() if name != "numpy" else name


def operations(name: str) -> Operations:
    """The array operations of a backend: those of torch for "torch" and "cuda", else NumPy's.

    Raises:
        InvalidInput: as of :func:`backend`.
    """
    if name not in TORCH:
        return NUMPY
    try:
        import torch

        from reference_decoder.torch_operations import TorchOperations
    except ImportError as error:
        raise missing_package("torch", "neural") from error
    if name == "cuda" and not torch.cuda.is_available():
        raise InvalidInput("input-backend", "torch sees no CUDA GPU here", field="backend")
    return TorchOperations("cpu" if name == "torch" else "cuda")
