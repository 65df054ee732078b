"""Run time against error: equal error, what is patched while it is measured, the least a decode could take, tables."""

from __future__ import annotations

import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import gain, time_error_limit, time_error_precision
from benchmarks.time_error import PAGE, SECTIONS, texts
from benchmarks.time_error_decoding import ways
from benchmarks.time_error_files import at_equal_error
from fuzz.testing.neural_scenes import neural_scene
from fuzz.testing.scenes import random_scene
from reference_decoder.decode import decode, decode_scene
from reference_encoder.decide import lattice
from reference_encoder.networks import affordable, defaults
from reference_encoder.networks import candidates as neural
from scarfmt.coding.writer import write_scene
from scarfmt.container.schema import Profile
from scarfmt.counters import Coding, Counters, Part
from scarfmt.engines import absence
from scarfmt.scene.codebooks import Codebooks

DECODE = {"min": 0.5, "median": 0.6, "cpu": 0.4, "peak_bytes": 1 << 20, "runs": 3}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with predictors and an index network."""
    path = tmp_path_factory.mktemp("files") / "neural.scar"
    path.write_bytes(write_scene(neural_scene(1, Profile.EXPLICIT)))
    return path


def _run(effort: int, quality: float, psnr: float, size: int) -> dict[str, Any]:
    return {"effort": effort, "quality": quality, "psnr_db": psnr, "bytes": size, "seconds": 2.0, "peak_bytes": 1 << 20}


def test_bytes_are_compared_where_all_efforts_have_files_on_both_sides() -> None:
    """At the best PSNR of the lower quality; halfway in dB is the geometric mean of bytes."""
    runs = [_run(1, 41, 40.0, 100), _run(1, 43, 44.0, 400), _run(2, 41, 42.0, 150), _run(2, 43, 43.0, 300)]
    goal, equal = at_equal_error(runs)
    assert goal == 42.0
    assert equal == pytest.approx({1: 200.0, 2: 150.0})


def test_nothing_is_extrapolated() -> None:
    with pytest.raises(ValueError, match="both sides"):
        at_equal_error([_run(1, 41, 40.0, 100), _run(1, 43, 41.0, 120), _run(2, 41, 42.0, 150)])


def test_flat_heads_leave_codewords_as_they_are() -> None:
    """Codewords keep their order inside `flat_heads` only; afterwards heads have two levels again."""
    books = Codebooks(np.arange(128).reshape(64, 2), np.arange(120).reshape(60, 2))
    uses = np.arange(64)[::-1], np.arange(60)
    with gain.flat_heads():
        same, clusters = neural.arrange(books, uses)
    assert same is books
    assert [found.sizes for found in clusters] == [(), ()]
    assert np.array_equal(clusters[0].ranks, np.arange(64))
    assert neural.arrange(books, uses)[1][0].sizes


def test_bits_are_changed_inside_only() -> None:
    with time_error_precision.network_bits(weight=8), gain.hardly_trained():
        assert affordable.shape_for(10**6, 24).weight_bits == 8
        assert neural.training_for(10**5, 2, 0).epochs == 1
    with time_error_precision.network_bits(activation=12) as made:
        assert affordable.shape_for(10**6, 24).top == (1 << 11) - 1
    assert made[0].weight_bits == defaults.shape_for(10**6, 24).weight_bits
    assert affordable.shape_for(10**6, 24) == defaults.shape_for(10**6, 24)


def test_more_bits_of_positions_make_cells_smaller() -> None:
    positions = np.random.default_rng(0).random((500, 3))
    step = np.full(500, 0.01)
    cells = []
    for more in (-1, 0, 2):
        with time_error_precision.position_bits(more):
            cells.append(float(lattice.place(positions, step).cell.mean()))
    assert cells[0] / cells[1] == pytest.approx(2.0)
    assert cells[1] / cells[2] == pytest.approx(4.0)


def test_stages_are_parts_of_the_whole(file: Path) -> None:
    """Every name is one that a decode calls, and what they took fits into the whole."""
    seconds: defaultdict[str, float] = defaultdict(float)
    with time_error_limit.stage_clock(seconds):
        assert len(decode_scene(file, threads=1))
    # In this file the network codes all indices, so that tiles are read stream by stream.
    # World units are told only where NumPy computes them.
    absent = {"indices, static", "whole tiles", *([] if absence() else ["to world units"])}
    assert set(seconds) == set(time_error_limit.STAGES) - absent
    report = time_error_limit.stages({"file": str(file)})["stages"]
    assert math.isclose(sum(report.values()), 2 * report["whole"])
    named = [report[name] for name in seconds]
    assert min(named) > 0
    # Stages within stages would count twice, and what is left for the rest be negative.
    assert sum(named) < report["whole"]


@pytest.mark.skipif(absence() is not None, reason="no kernel")
def test_a_stage_is_told_of_tiles_that_the_kernel_reads_at_once(tmp_path: Path) -> None:
    """Static files: else all of their time would count as reading and checks."""
    path = tmp_path / "static.scar"
    path.write_bytes(write_scene(random_scene(3, Profile.EXPLICIT)))
    seconds: defaultdict[str, float] = defaultdict(float)
    with time_error_limit.stage_clock(seconds):
        decode_scene(path, threads=1)
    assert set(seconds) == {"models", "whole tiles", "activation"}


def test_what_a_decode_cannot_leave_out_is_what_its_counters_count(file: Path) -> None:
    """Symbols that take bits, and the multiply-adds of predictors; products of the network are at least as many."""
    kept, counters = time_error_limit.record(str(file)), Counters()
    decoded = decode(file, counters=counters)
    assert 0 < sum(kept.modelled.values()) <= counters.symbols_of(codings=[Coding.MODELLED])
    tabled = counters.symbols_of(codings=[Coding.STATIC, Coding.UNIFORM])
    assert 0 < sum(count for _, count in kept.tables.values()) <= tabled
    products = sum(times * a * b * c for (a, b, c), times in kept.products.items())
    assert products >= counters.multiply_adds[Part.PREDICTORS]
    assert len(kept.arrays) >= len(decoded.arrays())


def test_the_least_is_measured_part_by_part(file: Path) -> None:
    found = time_error_limit.least({"file": str(file)})
    assert set(found["parts"]) == set(time_error_limit.PARTS)
    assert all(0 <= seconds < math.inf for seconds in found["parts"].values())
    assert found["parts"]["multiply-adds"] == pytest.approx(found["multiply_adds"] * found["multiply_add_ns"] / 1e9)
    assert found["parts"]["rANS"] > 0


def test_every_way_that_is_there_is_measured() -> None:
    """Both numbers of threads are measured, and both engines if the kernel is built."""
    found = ways()
    assert {way["threads"] for way in found.values()} == {1, 2}
    switches = {way["environment"]["SCARFMT_KERNEL"] for way in found.values()}
    assert switches == ({"0", "1"} if absence() is None else {"0"})


def _results() -> dict[str, Any]:
    layer = {"bytes": 100, "psnr_db": 30.0, "ssim": 0.9, "anchors": 5, "decode": {"1": DECODE, "2": DECODE}}
    told = {"seconds": 0.001, "bytes_read": 2280, "reads": 1, "peak_bytes": 1 << 20}
    common = {"scene": "a scene", "quality": 41.0}
    row = {"value": 41.0, "bytes": 5, "psnr_db": 30.0, "ssim": 0.9, "decode": DECODE}
    network = {"weight_bits": 4, "activation_bits": 9, "swept": "weights", "index_bytes": 7, "train_seconds": 1.0}
    place = {"axis_bits": 9.0, "positions_bits": 8.0, "position_residual_bits": 3.0}
    kinds = [
        {"kind": kind, "bytes": size, "multiply_adds": 3, "decode": DECODE}
        for kind, size in ((gain.STATIC, 200), (gain.NEURAL, 190))
    ]
    stages = {"models": 1.0, "whole": 3.0}
    least = {"parts": dict.fromkeys(time_error_limit.PARTS, 0.5), "symbols": 10, "multiply_adds": 20}
    least["multiply_add_ns"] = 0.01
    return {
        "layers": {"a": {**common, "layers": [layer], "count": 9, "other": {"export": told, "inspect": told}}},
        "efforts": {"a": {"scene": "a scene", "runs": [_run(1, 41, 40.0, 100), _run(1, 47, 44.0, 400)]}},
        "precision": {
            "a": {
                **common,
                "networks": [{**network, "decode": DECODE}],
                "positions": [{**row, **place}],
                "steps": [{**row, "steps": {"scale": 2.5}}],
            }
        },
        "entropy": {"a": {**common, "kinds": kinds}},
        "ways": {"a": {**common, "ways": {"numpy": DECODE, "torch": {**DECODE, "median": 0.3}}, "missing": ["no GPU"]}},
        "limit": {"a": {**common, "kernel": {"off": stages, "on": {"models": 0.5, "whole": 1.5}}, "least": least}},
    }


def test_every_section_has_a_table_and_a_place_on_the_page() -> None:
    found = texts(_results())
    page = PAGE.read_text(encoding="utf-8")
    assert set(found) == set(SECTIONS)
    for name in found:
        assert page.count(f"<!-- {name}:begin -->") == page.count(f"<!-- {name}:end -->") == 1


def test_sections_without_results_are_left_as_they_are() -> None:
    assert set(texts({"layers": _results()["layers"]})) == {"layers"}


def test_tables_compare_with_what_they_say() -> None:
    """Bytes with static tables, ways with the first, a decode with the least it could take."""
    found = texts(_results())
    assert "| network | 190 | -5.0 % |" in found["entropy"]
    assert "| torch | 0.300 (0.500) | 0.400 | 2.00 |" in found["ways"]
    assert "no GPU" in found["ways"]
    assert "| 1.500 | 2.0 | 1.0 |" in found["limit"]
    assert "100 at 40.00 dB" in found["efforts"]
