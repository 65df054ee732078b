"""A trained Scaffold-GS style anchor model as a numpy `.npz` archive. Nothing in it is ever unpickled.

Arrays, float16, float32 or float64; N anchors, K Gaussian slots for each, D features:

- ``anchor`` (N, 3): positions, world units.
- ``feat`` (N, D).
- ``offset`` (N, K, 3): slot centres, in units of exp(scaling[:3]).
- ``scaling`` (N, 6): natural logs.
- ``mlp_opacity.{0,2}.{weight,bias}``, ``mlp_cov...``, ``mlp_color...``: weights (out, in), biases (out,); the input
  is [feature, view direction, distance], D + 4 wide, or without the distance (Scaffold-GS's ``add_*_dist=False``)
  D + 3 wide, the same for all three; the outputs are K, 7K and 3K wide.
- ``slot_mask`` (N, K) bool, optional: slots that may ever be drawn.

Other arrays (``voxel_size``, ``n_offsets``...) are ignored. Evaluation: Scaffold-GS, section 3.
"""

from __future__ import annotations

import tokenize
from os import PathLike
from typing import IO, BinaryIO

import numpy as np
from numpy.typing import NDArray

from scarfmt.atomic import atomic_write
from scarfmt.formats.source import Archive, Source, member_names, open_archive
from scarfmt.scene.gaussians import AnchorModel, Mlp

_PARTS = ("anchor", "feat", "offset", "scaling")
# numpy evaluates the header as a Python literal, and makes a type of what it says; these are all the ways in which
# that fails.
_HEADER_ERRORS = (
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    AttributeError,
    EOFError,
    SyntaxError,
    RecursionError,
    MemoryError,
    tokenize.TokenError,
)
_OUTPUTS_PER_SLOT = {"opacity": 1, "cov": 7, "color": 3}


def sniff(source: Source) -> bool:
    """Whether the content is a ZIP archive holding the arrays of an anchor model."""
    return {f"{name}.npy" for name in _PARTS} <= set(member_names(source))


def load(source: Source) -> AnchorModel:
    """Read an anchor model.

    Raises:
        InvalidInput: damaged, or arrays are missing or of the wrong shape.
        LimitExceeded: an array unpacks to more than any model needs.
    """
    with open_archive(source) as archive:
        anchors, features, offsets, scaling = (_floats(archive, name) for name in _PARTS)
        count = len(anchors) if anchors.ndim else 0
        slots = offsets.shape[1] if offsets.ndim == 3 else 0
        width = features.shape[1] if features.ndim == 2 else 0
        _check_shape(source, "anchor", anchors, (count, 3))
        _check_shape(source, "feat", features, (count, width))
        _check_shape(source, "offset", offsets, (count, slots, 3))
        _check_shape(source, "scaling", scaling, (count, 6))
        mlps = _read_networks(archive, width, slots)
        mask = _read_mask(archive, (count, slots))
    with np.errstate(over="ignore"):  # doubles beyond float32 become infinities, which a later check reports
        return AnchorModel(
            anchors.astype(np.float64),
            features.astype(np.float32),
            offsets.astype(np.float32),
            scaling.astype(np.float32),
            mlps,
            mask,
        )


def save_anchor_npz(model: AnchorModel, destination: str | PathLike[str] | BinaryIO, *, force: bool = False) -> None:
    """Write the layout above, compressed. Positions become float32 where that loses nothing, else stay float64.

    Args:
        model: a model with all three networks.
        destination: a path, written whole or not at all, or an open binary file.

    Raises:
        InvalidInput: the file exists and `force` is not set.
    """
    single = model.anchors.astype(np.float32)
    arrays: dict[str, NDArray[np.generic]] = {
        "anchor": single if np.array_equal(single.astype(np.float64), model.anchors, equal_nan=True) else model.anchors,
        "feat": model.features,
        "offset": model.offsets,
        "scaling": model.log_scaling,
    }
    for name, mlp in model.mlps.items():
        for layer, weight, bias in zip((0, 2), mlp.weights, mlp.biases, strict=True):
            arrays[f"mlp_{name}.{layer}.weight"] = weight
            arrays[f"mlp_{name}.{layer}.bias"] = bias
    if model.slot_mask is not None:
        arrays["slot_mask"] = model.slot_mask
    if isinstance(destination, str | PathLike):
        with atomic_write(destination, force=force) as stream:
            np.savez_compressed(stream, allow_pickle=False, **arrays)
    else:
        np.savez_compressed(destination, allow_pickle=False, **arrays)


def _read_networks(archive: Archive, width: int, slots: int) -> dict[str, Mlp]:
    """The three networks, of D + 4 inputs, or all of D + 3 (SPEC §9.6); `width` is D."""
    mlps = {name: _read_mlp(archive, name, outputs * slots) for name, outputs in _OUTPUTS_PER_SLOT.items()}
    inputs = {name: mlp.weights[0].shape[1] for name, mlp in mlps.items()}
    if set(inputs.values()) not in ({width + 3}, {width + 4}):
        message = f"networks of {inputs} inputs, expected {width + 3} or {width + 4}, the same for all"
        raise archive.source.corrupt(message, field="mlp_opacity.0.weight")
    return mlps


def _read_mlp(archive: Archive, name: str, outputs: int) -> Mlp:
    names = [f"mlp_{name}.{layer}.{part}" for layer in (0, 2) for part in ("weight", "bias")]
    with np.errstate(over="ignore"):
        first, first_bias, second, second_bias = (_floats(archive, part).astype(np.float32) for part in names)
    hidden, inputs = first.shape if first.ndim == 2 else (0, 0)
    shapes = ((hidden, inputs), (hidden,), (outputs, hidden), (outputs,))
    for part, array, shape in zip(names, (first, first_bias, second, second_bias), shapes, strict=True):
        _check_shape(archive.source, part, array, shape)
    return Mlp((first, second), (first_bias, second_bias))


def _read_mask(archive: Archive, shape: tuple[int, int]) -> NDArray[np.bool_] | None:
    if "slot_mask.npy" not in archive.members:
        return None
    mask = _array(archive, "slot_mask", "b")
    _check_shape(archive.source, "slot_mask", mask, shape)
    return mask.astype(np.bool_)


def _check_shape(source: Source, name: str, array: NDArray[np.generic], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise source.corrupt(f"expected shape {shape}, got {array.shape}", field=name)


def _floats(archive: Archive, name: str) -> NDArray[np.generic]:
    return _array(archive, name, "f")


def _array(archive: Archive, name: str, kind: str) -> NDArray[np.generic]:
    """One member as an array. What its header declares is compared with the archive before it is unpacked."""
    member = f"{name}.npy"
    with archive.open(member) as stream:
        shape, fortran, dtype = _read_header(archive.source, name, stream)
        if dtype.kind != kind or dtype.itemsize > 8:
            raise archive.source.corrupt(f"type {dtype}, expected kind {kind!r}", field=name)
        expected = dtype.itemsize
        for length in shape:
            expected *= length
        if expected != archive.members[member].file_size - stream.tell():
            raise archive.source.corrupt(f"shape {shape} needs {expected} bytes", field=name)
        flat = np.frombuffer(stream.read(), dtype)
    try:
        array: NDArray[np.generic] = flat.reshape(shape, order="F" if fortran else "C")
    except (ValueError, TypeError, OverflowError) as error:  # more dimensions, or longer ones, than numpy has
        raise archive.source.corrupt(f"shape {shape}: {error}", field=name) from error
    return array


def _read_header(source: Source, name: str, stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[np.generic]]:
    """Shape, whether in Fortran order, and type, as the `.npy` header at the start of `stream` declares them."""
    try:
        version = np.lib.format.read_magic(stream)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        return read_header(stream)
    except _HEADER_ERRORS as error:
        reason = str(error).partition(":")[0]  # what follows names objects of Python's parser
        raise source.corrupt(f"damaged .npy header ({reason})", field=name) from error
