"""`scarfmt stream`: what comes first for a view, and pictures of what has come."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from scarfmt.render.images import read_pixels
from scarfmt.tools.annotate import with_streaming
from tests.blocks.test_streaming import told
from tests.cli.conftest import Run
from tests.streaming.test_plan import TOYS

VIEW = ("--camera", "0,0,6", "--target", "0,0,0", "--up", "0,1,0", "--fov", "45")


def test_the_plan_is_printed(run: Run) -> None:
    """A line a step with bytes and gain; as JSON the same."""
    text = run("stream", TOYS, "--plan", *VIEW)
    assert text.exit_code == 0
    report = json.loads(run("stream", TOYS, "--plan", "--json", *VIEW).stdout)
    assert not report["told"]
    assert len(text.stdout.splitlines()) == len(report["steps"]) + 2
    totals = [step["total"] for step in report["steps"]]
    assert totals == sorted(totals)
    assert totals[0] == report["front"] + report["steps"][0]["bytes"]
    seen = [step["layer"] for step in report["steps"] if step["in_picture"] > 0]
    assert set(seen[: seen.index(2)]) == {1}


def test_a_budget_ends_the_plan(run: Run) -> None:
    """In bytes of tiles and models, and in Gaussians."""
    small = json.loads(run("stream", TOYS, "--plan", "--json", *VIEW, "--budget", "50000").stdout)
    assert sum(step["bytes"] for step in small["steps"]) <= 50_000
    few = json.loads(run("stream", TOYS, "--plan", "--json", *VIEW, "--splats", "1000").stdout)
    assert 0 < len(few["steps"]) < len(small["steps"])


def test_a_file_that_tells_a_view_needs_none(run: Run, tmp_path: Path) -> None:
    """The file's own view and its own gains are used."""
    path = tmp_path / "told.scar"
    path.write_bytes(with_streaming(TOYS.read_bytes(), told(24, 5)))
    assert json.loads(run("stream", path, "--plan", "--json").stdout)["told"]
    assert run("stream", TOYS, "--plan").exit_code == 0


def test_pictures_get_nearer_to_the_last(run: Run, tmp_path: Path) -> None:
    """One after every so many bytes, named by them; each is reported."""
    done = run("stream", TOYS, tmp_path / "out", *VIEW, "--every", "40000", "--size", "96x72", "--json")
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    assert [row["bytes"] for row in report] == sorted(row["bytes"] for row in report)
    pictures = [read_pixels(tmp_path / "out" / row["picture"]).astype(float) for row in report]
    errors = [float(np.abs(picture - pictures[-1]).mean()) for picture in pictures]
    assert len(errors) >= 3
    assert errors[-1] == 0
    assert errors[0] > errors[-2] > 0


def test_wrong_views_and_missing_outputs_are_told(run: Run) -> None:
    """Wrong views and missing outputs are usage errors."""
    assert run("stream", TOYS).exit_code == 2
    assert run("stream", TOYS, "--plan", "--camera", "1,2").exit_code == 2
    assert run("stream", TOYS, "--plan", "--camera", "0,0,1", "--target", "0,0,1").exit_code == 2
