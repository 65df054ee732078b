"""What can compute the index network: NumPy, or torch on a CPU or an NVIDIA GPU (SPEC §10.5: equal results)."""

from __future__ import annotations

from scarfmt.errors import InvalidInput, missing_package
from scarfmt.neural.operations import NUMPY, Operations

BACKENDS = ("numpy", "torch", "cuda")


def operations(backend: str) -> Operations:
    """The array operations of a backend.

    Args:
        backend: "numpy"; "torch", on the CPU; "cuda".

    Raises:
        InvalidInput: ``input-backend`` for another name, or "cuda" without such a GPU; ``input-dependency`` without
            torch.
    """
    if backend == "numpy":
        return NUMPY
    if backend not in BACKENDS:
        raise InvalidInput("input-backend", f"{backend!r} is not one of {', '.join(BACKENDS)}", field="backend")
    try:
        import torch

        from reference_decoder.torch_operations import TorchOperations
    except ImportError as error:
        raise missing_package("torch", "neural") from error
    if backend == "cuda" and not torch.cuda.is_available():
        raise InvalidInput("input-backend", "torch sees no CUDA GPU here", field="backend")
    return TorchOperations("cpu" if backend == "torch" else "cuda")
