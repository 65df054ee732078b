"""The fuzzed functions: everything a caller can make of untrusted bytes. Only ScarError may come out."""

from __future__ import annotations

import hashlib
import warnings

import numpy as np

from reference_decoder.anchors import gaussians
from reference_decoder.decode import decode
from scarfmt.blocks.metadata import read_metadata
from scarfmt.container.file import Container
from scarfmt.container.source import BytesSource
from scarfmt.errors import ScarError
from scarfmt.scene.gaussians import AnchorModel
from scarfmt.tools.dump import Dump
from scarfmt.tools.truncate import truncate
from scarfmt.tools.validate import validate

MAX_DRAWN = 2000
"""Anchors of which Gaussians are made for a camera, too."""


def decode_all(data: bytes) -> str:
    """Decode all layers to arrays and reconstruct what they stand for; the refusal id, or ``""``."""
    try:
        result = decode(data)
        scene = result.scene
        assert len(scene) == len(result)
        if isinstance(scene, AnchorModel) and len(scene) <= MAX_DRAWN:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                gaussians(scene, np.zeros(3))
        read_metadata(Container(BytesSource(data)))
    except ScarError as error:
        return error.refusal
    return ""


def decode_by(data: bytes, native: bool) -> str:
    """The result of one engine for all layers: the SHA-256 of all arrays, types and shapes included, or the refusal
    id."""
    try:
        arrays = decode(data, native=native).arrays()
    except ScarError as error:
        return error.refusal
    total = hashlib.sha256()
    for values in arrays:
        total.update(f"{values.dtype.str} {values.shape}\0".encode() + values.tobytes())
    return total.hexdigest()


def validate_all(data: bytes) -> str:
    """The first error that validation finds, or ``""``."""
    result = validate(BytesSource(data))
    return "" if result.valid else next(f.refusal for f in result.findings if f.severity == "error")


def dump_all(data: bytes) -> str:
    """Annotate every byte; the id of the first refusal, or ``""``.

    Raises:
        AssertionError: a byte has no row, or two.
    """
    annotated = Dump(BytesSource(data))
    past = 0
    for row in annotated.rows():
        if not row.content:
            assert row.offset == past, (row, past)
            past += row.length
    assert past == len(data), (past, len(data))
    return annotated.refusals[0].refusal if annotated.refusals else ""


def truncated(data: bytes) -> str:
    """Keep the first layer; the refusal id, or ``""``."""
    try:
        truncate(BytesSource(data), 1)
    except ScarError as error:
        return error.refusal
    return ""
