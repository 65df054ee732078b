"""Tables of the ablations: what is averaged, what is left out, and at which rates curves are compared."""

from __future__ import annotations

import math
from typing import Any

import pytest

from benchmarks.ablation import SCENES, STUDIES, Job, jobs, network_variants
from benchmarks.ablation_tables import STUDIES as TABLES
from benchmarks.ablation_tables import common_points, mean, spread

BASE = {"model_bytes": 10.0, "grid_bytes": 2.0, "in_sample": 3.0, "held_out": 4.0, "seconds": 5.0, "packed_bytes": 9}


def _record(study: str, variant: str, seed: int = 0, **more: Any) -> dict[str, Any]:
    return {"scene": "a scene", "study": study, "variant": variant, "seed": seed, "full": False, **BASE, **more}


def test_keys_of_all_jobs_differ_so_that_a_run_can_be_taken_up_again() -> None:
    keys = [job.key for scene in SCENES for full in (False, True) for job in jobs(scene, full)]
    assert len(set(keys)) == len(keys)


def test_every_study_has_jobs_and_a_table() -> None:
    assert {job.study for job in jobs(SCENES[0], False)} == set(STUDIES) == set(TABLES)


def test_every_network_has_a_float_one_of_its_width_and_head_to_be_compared_with() -> None:
    variants = network_variants()
    for name, (shape, quantised, clustered) in variants.items():
        alike = variants[f"{name}, float"] if f"{name}, float" in variants else variants["H 16, float"]
        if quantised:
            assert (alike[0].hidden, alike[1], alike[2]) == (shape.hidden, False, clustered)


def test_the_base_network_is_measured_once() -> None:
    shapes = list(network_variants().values())
    assert len(set(shapes)) == len(shapes)


def test_curves_are_compared_only_where_all_of_them_have_a_point() -> None:
    curves = [{"4": 0.0, "9": 0.0, "10": 0.0, "11": 0.0}, {"9": 0.0, "10": 0.0, "11": 0.0, "30": 0.0}]
    assert common_points(curves, 1) == ["10"]
    assert set(common_points(curves, 9)) == {"9", "10", "11"}
    assert common_points([{"4": 0.0}, {"5": 0.0}]) == []


def test_a_spread_needs_two_seeds() -> None:
    assert spread([7.0, 3.0, 4.0]) == 2.0
    assert math.isnan(spread([7.0]))
    assert math.isnan(mean([_record("context", "static tables", bytes=None)], "bytes"))


def test_the_context_table_averages_seeds_and_compares_with_static_tables() -> None:
    records = [_record("context", "static tables", bytes=1000.0, held_out=None)]
    records += [_record("context", "GRU", seed, bytes=800.0 + 20 * seed) for seed in (0, 1)]
    row = next(line for line in TABLES["context"](records).splitlines() if line.startswith("| GRU |"))
    assert row == "| GRU | 3.000 | 4.000 | 12 | 810 | 10 | -19.0 % | 5 |"


def test_quantisers_are_brought_to_equal_error_at_the_price_of_a_bit() -> None:
    common = {"symbols": 5, "static_bytes": 6.0, "bytes": 7.0, "codebook_bytes": 8, "psnr_db": 40.0, "rate": 0.5}
    records = [
        _record("quantiser", "A", file_bytes=1000, latent_error=100.0, **common),
        _record("quantiser", "B", file_bytes=990, latent_error=180.0, **common),
    ]
    rows = TABLES["quantiser"](records).splitlines()[-2:]
    assert [row.split(" | ")[-1] for row in rows] == ["1,000 |", "1,010 |"]


def test_integers_are_compared_with_floats_of_their_own_width() -> None:
    records = [_record("network", name, bytes=100.0, held_out=held) for name, held in (("H 16", 4.4), ("H 8", 5.5))]
    records += [_record("network", f"{name}, float", held_out=held) for name, held in (("H 16", 4.0), ("H 8", 5.0))]
    rows = [line.split(" | ") for line in TABLES["network"](records).splitlines() if line.startswith("| H")]
    assert [row[0] for row in rows] == ["| H 8", "| H 16"]
    assert [row[4:6] for row in rows] == [["5.000", "+10.0 %"], ["4.000", "+10.0 %"]]


@pytest.mark.parametrize("study", STUDIES)
def test_a_table_without_records_is_empty(study: str) -> None:
    assert TABLES[study]([]) == ""


def test_the_full_mode_is_kept_apart() -> None:
    assert Job("s", "context", "GRU", full=True).key != Job("s", "context", "GRU").key
