"""The planner of the browser package decides what Python's decides."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from tests.streaming.plan_cases import answer, random_case, write

CASES = 300


def test_both_planners_decide_alike(web: Path, tmp_path: Path) -> None:
    """Hundreds of scenes, blocks, cameras and states of a download: the same steps in the same order."""
    cases = [random_case(seed) for seed in range(1000, 1000 + CASES)]
    write(tmp_path / "cases.json", cases)
    command = ["node", str(web / "dist" / "tests" / "plans.mjs"), str(tmp_path / "cases.json")]
    found = json.loads(subprocess.run(command, cwd=web, capture_output=True, timeout=120, check=True).stdout)
    assert len(found) == CASES
    different = [seed for seed, (theirs, case) in enumerate(zip(found, cases, strict=True)) if theirs != answer(case)]
    assert different == []
