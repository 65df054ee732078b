"""train with its trainer: a tiny capture becomes a file, also after a kill the same one; Ctrl-C ends it early."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import scarfmt
from reference_encoder.training import run as trainer
from reference_encoder.training.options import FINISHING, Progress
from tests.cli.conftest import python, run
from tests.reference_encoder.training import captures

SAID = ("--iterations", "30", "--layers", "2", "--seed", "3")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return captures.own(tmp_path_factory.mktemp("capture"))


@pytest.fixture(scope="module")
def whole(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The result of a training that nothing interrupts."""
    target = tmp_path_factory.mktemp("whole") / "a.scar"
    result = run("train", capture, target, *SAID)
    assert result.exit_code == 0, result.output
    assert f"layer 2: {target.stat().st_size:>12,} bytes" in result.stderr
    left = sorted(path.name for path in (target.parent / "a.scar.run").iterdir())
    assert left == ["held-out.txt", "log.jsonl", "plot.png"]
    return target.read_bytes()


def test_the_file_keeps_every_rule_and_every_prefix_is_one(whole: bytes) -> None:
    for layers in (1, 2):
        assert scarfmt.validate(scarfmt.truncate(whole, layers)).valid
    assert isinstance(scarfmt.decode_scene(whole), scarfmt.AnchorModel)


def test_killed_at_any_moment_the_same_command_goes_on_to_the_same_file(
    capture: Path, whole: bytes, tmp_path: Path
) -> None:
    """A training that is killed at any moment continues to the same file, and the same seed gives the same file."""
    done = python("-c", _KILLED.format(arguments=["train", str(capture), "a.scar", *SAID]), cwd=tmp_path)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.scar.run"]
    result = run("train", capture, tmp_path / "a.scar", *SAID)
    assert result.exit_code == 0, result.output
    assert "continuing from iteration 1" in result.stderr
    assert (tmp_path / "a.scar").read_bytes() == whole


_KILLED = """
import os, signal, sys
from reference_encoder.training import run
run._SAVE_SECONDS = 0.0
train = run.train
def killed(now):
    if now.iteration == 15:
        os.kill(os.getpid(), signal.SIGKILL)
run.train = lambda capture, options, folder, report, *asked: train(capture, options, folder, killed, *asked)
from scarfmt import cli
sys.argv[1:] = {arguments!r}
cli.main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_ctrl_c_gives_a_sound_file_early_and_can_be_gone_on_from(
    capture: Path, whole: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether or not tests run where interrupts are ignored, as in the background of a shell."""
    train = trainer.train
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def interrupted(capture: Any, options: Any, folder: Any, report: Callable[[Progress], None], *asked: Any) -> Any:
        def tell(now: Progress) -> None:
            report(now)
            if now.iteration == 8 and now.phase != FINISHING:
                os.kill(os.getpid(), signal.SIGINT)

        return train(capture, options, folder, tell, *asked)

    with monkeypatch.context() as patch:
        patch.setattr(trainer, "train", interrupted)
        result = run("train", capture, tmp_path / "a.scar", *SAID)
    signal.signal(signal.SIGINT, before)
    assert result.exit_code == 130, result.output
    early = (tmp_path / "a.scar").read_bytes()
    assert scarfmt.validate(early).valid
    assert early != whole
    result = run("train", capture, tmp_path / "a.scar", *SAID, "--force")
    assert "continuing from iteration 8" in result.stderr
    assert (tmp_path / "a.scar").read_bytes() == whole
