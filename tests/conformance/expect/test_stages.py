"""The stages of arrays, how arrays are pinned, and the trace of the worked file."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from conformance.expect.expectations import expected_layers
from conformance.expect.json_text import json_text
from conformance.expect.stages import pinned, pinned_stages, stage_of
from conformance.scenes.made import worked_scene
from scarfmt.coding.writer import keep_layers
from tests.conformance.vector_files import VECTORS, expectation_of


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        ("codebook.0", "models"), ("grid.bits.12", "models"), ("grid.features", "context"), ("embedding", "context"),
        ("context.SCALE.2.1", "context"), ("frequencies.INDICES.3", "frequencies"), ("index", "indices"),
        ("tile", "integers"), ("v.OFFSETS", "integers"), ("codeword_sum", "sums"), ("position", "values"),
        ("value.SCALE", "values"), ("latent", "values"),
    ],
)  # fmt: skip
def test_the_stage_of_an_array(name: str, stage: str) -> None:
    assert stage_of(name) == stage


def test_an_array_is_pinned_by_its_bytes_in_c_order() -> None:
    """Whatever its order in memory, and whatever the byte order of the machine."""
    array = np.arange(12, dtype="<u2").reshape(3, 4)
    expected = {
        "dtype": "<u2",
        "shape": [3, 4],
        "sha256": hashlib.sha256(bytes(x for n in range(12) for x in (n, 0))).hexdigest(),
        "first": [0, 1, 2, 3, 4, 5, 6, 7],
    }
    assert pinned(array) == pinned(np.asfortranarray(array)) == pinned(array.astype(">u2")) == expected


def test_stages_without_arrays_are_left_out() -> None:
    stages = pinned_stages({"index": np.zeros((0, 2), "<u2"), "codebook.0": np.zeros((1, 1), "<i4")})
    assert list(stages) == ["models", "indices"]


def test_frequencies_of_the_worked_file_are_those_of_appendix_b() -> None:
    """Layer 2: the first symbol of SCALE has the table of layer 1 (B.3), that of OPACITY a new one."""
    arrays = expectation_of(VECTORS / "worked")["layers"][1]["stages"]["frequencies"]["arrays"]
    first = {name: array["first"] for name, array in arrays.items()}
    assert first["frequencies.SCALE"] == [1 << 23, 1 << 23]
    assert first["frequencies.OPACITY"] == [1 << 24]
    # One new anchor: its nine bits are one uniform number of 512.
    assert arrays["frequencies.POSITIONS"]["shape"] == [512]


def test_expectations_of_a_layer_are_those_of_the_scene_cut_there() -> None:
    """The package's way of dropping layers, another program, gives the same."""
    scene = worked_scene()
    for layer, arrays in enumerate(expected_layers(scene), start=1):
        again = expected_layers(keep_layers(scene, layer))[-1]
        assert arrays.keys() == again.keys()
        assert all(np.array_equal(arrays[name], again[name]) for name in arrays)


def test_json_text_is_the_value_and_short_where_it_fits() -> None:
    value = {"numbers": list(range(5)), "long": ["x" * 60, "y" * 60], "none": None, "text": "Grüße"}
    lines = json_text(value).splitlines()
    assert lines[1] == ' "numbers": [0, 1, 2, 3, 4],'
    assert lines[3] == '  "' + "x" * 60 + '",'
    assert json_text([]) == "[]\n"
