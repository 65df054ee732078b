"""The suite's command against the decoders of this repository, asked as a third party's would be.

test_vectors.py asks the same questions in this process; here it is the programs that count.
"""

import json
import subprocess
import sys

import pytest

READABLE = f"{sys.executable} -m conformance.decoders.python"
SOME = ("worked", "edge/anchors-camera", "valid/index-plain", "invalid/cut", "either/limit-tiles")


def _run(*arguments):
    """The report of a run of the suite, and what went wrong."""
    command = [sys.executable, "-m", "scarfmt", "conformance", "run", "--format", "json", *arguments]
    run = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)
    assert run.stdout, run.stderr
    return json.loads(run.stdout), run


@pytest.mark.parametrize(
    "way",
    [
        (),
        ("--session",),
        ("--decoder", f"{READABLE} {{file}} --layers {{layers}} --stage {{stage}}"),
        ("--session", f"{READABLE} --session"),
    ],
    ids=["reference", "reference-session", "readable", "readable-session"],
)
def test_each_way_of_asking_scores_the_same(way):
    """As printed in README, one process a question and a session: the camera of the anchor profile reaches all."""
    report, run = _run(*way, *(word for name in SOME for word in ("--only", name)))
    assert [row["id"] for row in report["vectors"] if row["outcome"] != "passed"] == [], run.stderr[-2000:]
    assert run.returncode == 0
    assert len(report["vectors"]) == len(SOME)


@pytest.mark.slow
def test_the_reference_passes_every_vector_one_process_a_question():
    """The command without options, as README has it."""
    report, run = _run()
    assert [row["id"] for row in report["vectors"] if row["outcome"] != "passed"] == [], run.stderr[-2000:]
