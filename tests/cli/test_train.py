"""train: the options that reach the trainer, its messages, and what stays when it is interrupted."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import scarfmt
from reference_encoder.training.capture import Capture
from reference_encoder.training.options import LayerQuality, Progress, Suspended, Trained, TrainOptions, never
from scarfmt.errors import InvalidInput
from tests.cli.conftest import python, run
from tests.reference_encoder.training import captures

NOW = Progress(1200, 12_000, 60.0, 540.0, "grow", 27.314, 512_345, 38_201, 90_000, 0.1)


@dataclass
class Trainer:
    """A stand-in for the trainer: keeps what it is given, writes a checkpoint as it would, and may be made to fail."""

    data: bytes = b"a scene"
    given: list[tuple[Capture, TrainOptions, Path | None]] = field(default_factory=list)
    meanwhile: Callable[[], object] = lambda: None

    def __call__(
        self, capture: Capture, options: TrainOptions, folder: Path | None, report: Any, stop: Any, leave: Any = never
    ) -> Trained:
        self.given.append((capture, options, folder))
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "checkpoint-00000005.pt").write_bytes(b"x")
            (folder / "log.jsonl").write_bytes(b"{}\n")
        report(NOW)
        self.meanwhile()
        if leave():
            raise Suspended(NOW)
        layers = (LayerQuality(80_000, 25.5, 0.8), LayerQuality(len(self.data), 29.25, 0.9))
        return Trained(self.data, layers, 12_000, 600.0)


@pytest.fixture
def trainer(monkeypatch: pytest.MonkeyPatch) -> Trainer:
    stand_in = Trainer()
    home = ModuleType("reference_encoder.training.run")
    monkeypatch.setattr(home, "train", stand_in, raising=False)
    monkeypatch.setitem(sys.modules, home.__name__, home)
    return stand_in


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return captures.own(tmp_path_factory.mktemp("capture"))


def test_options_reach_the_trainer(trainer: Trainer, capture: Path, tmp_path: Path) -> None:
    said = ("--iterations", 7, "--layers", 3, "--lambda", 2, "--seed", 5, "--last-layer", 9)
    more = ("--preset", "paper", "--device", "cuda", "--hold-out", 3)
    last = ("--resolution", 24, "--run", tmp_path / "r", "--size", 50_000)
    result = run("train", capture, tmp_path / "a.scar", *said, *more, *last)
    assert result.exit_code == 0, result.output
    ((read, options, folder),) = trainer.given
    chosen = {"preset": "paper", "device": "cuda"}
    numbers = TrainOptions(iterations=7, layers=3, last_layer=9, lambda_=2, size=50_000, seed=5)
    assert options == replace(numbers, **chosen)  # type: ignore[arg-type]
    assert (len(read.test), read.photos[0].camera.width, folder) == (3, 24, tmp_path / "r")


def test_a_run_ends_with_the_file_its_layers_and_no_checkpoint(trainer: Trainer, capture: Path, tmp_path: Path) -> None:
    """Log and plot stay beside the file; nothing goes to standard output."""
    target = tmp_path / "a.scar"
    result = run("train", capture, target)
    assert (result.exit_code, result.stdout) == (0, "")
    assert target.read_bytes() == trainer.data
    assert trainer.given[0][1] == TrainOptions(minutes=60.0)
    assert [path.name for path in (tmp_path / "a.scar.run").iterdir()] == ["log.jsonl"]
    assert "8 photos of 48x36, 1 held out; 60 points" in result.stderr
    assert "12,000 iterations in 10 min" in result.stderr
    assert "layer 2:            7 bytes   29.25 dB  SSIM 0.9000" in result.stderr
    assert run("train", capture, target, "-q", "--force").stderr == ""


def test_json_and_pipes(trainer: Trainer, capture: Path, tmp_path: Path) -> None:
    result = run("train", capture, tmp_path / "a.scar", "--json", "-q")
    assert json.loads(result.stdout)["layers"][0] == {"bytes": 80_000, "psnr": 25.5, "ssim": 0.8}
    piped = run("train", capture, "-", "-q")
    assert piped.stdout_bytes == trainer.data
    assert trainer.given[-1][2] is None


@pytest.mark.parametrize("spoil", ["no photos", "cut photo", "no folder"])
def test_a_bad_capture_is_one_line_and_leaves_nothing(trainer: Trainer, tmp_path: Path, spoil: str) -> None:
    folder = tmp_path / "capture"
    if spoil != "no folder":
        captures.own(folder)
        photo = folder / "images" / "photo3.png"
        photo.unlink() if spoil == "no photos" else photo.write_bytes(photo.read_bytes()[:99])
    result = run("train", folder, tmp_path / "a.scar")
    assert result.exit_code == 1
    assert result.stderr.startswith("scarfmt: error: ")
    assert result.stderr.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} <= {"capture"}
    assert trainer.given == []


def test_a_failure_of_the_trainer_leaves_its_checkpoint_and_no_file(
    trainer: Trainer, capture: Path, tmp_path: Path
) -> None:
    def fail() -> None:
        raise InvalidInput("input-options", "cannot")

    trainer.meanwhile = fail
    assert run("train", capture, tmp_path / "a.scar").exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["a.scar.run"]
    assert (tmp_path / "a.scar.run" / "checkpoint-00000005.pt").is_file()
    trainer.meanwhile = lambda: None
    assert "continuing from iteration 5\n" in run("train", capture, tmp_path / "a.scar").stderr


def test_a_slice_leaves_off_with_its_checkpoint_and_says_how_to_go_on(
    trainer: Trainer, capture: Path, tmp_path: Path
) -> None:
    """After its minutes, and not before; nothing is written until the same command has come to the end."""
    said = ("train", capture, tmp_path / "a.scar", "--slice-minutes")
    result = run(*said, 1e-9)
    assert result.exit_code == 75
    folder = tmp_path / "a.scar.run"
    assert "left off after iteration 1,200 of 12,000" in result.stderr
    assert result.stderr.endswith(f"the same command continues, from {folder}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["a.scar.run"]
    assert (folder / "checkpoint-00000005.pt").is_file()
    assert run(*said, 60).exit_code == 0
    assert (tmp_path / "a.scar").read_bytes() == trainer.data


_INTERRUPTED = """
import os, signal, sys, time
from types import ModuleType
from pathlib import Path
from reference_encoder.training.options import Trained, LayerQuality
signal.signal(signal.SIGINT, signal.default_int_handler)
def train(capture, options, folder, report, stop, leave):
    folder.mkdir()
    (folder / "checkpoint-00000005.pt").write_bytes(b"x")
    for _ in range(2):
        os.kill(os.getpid(), signal.SIGINT)
    while not stop():
        time.sleep(0.01)
    return Trained(b"best so far", (LayerQuality(11),), 5, 1.0)
home = ModuleType("reference_encoder.training.run")
home.train = train
sys.modules[home.__name__] = home
from scarfmt import cli as command
sys.argv[1:] = ["train", {capture!r}, "out.scar"]
command.main()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_a_second_ctrl_c_aborts(capture: Path, tmp_path: Path) -> None:
    done = python("-c", _INTERRUPTED.format(capture=str(capture)), cwd=tmp_path)
    assert done.returncode == 130
    assert b"Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["out.scar.run"]


def test_the_library_trains_the_same(trainer: Trainer, capture: Path, tmp_path: Path) -> None:
    """From a path, or from a capture that was read with options of its own."""
    trained = scarfmt.train(capture, scarfmt.TrainOptions(iterations=3), folder=tmp_path / "run")
    assert trained.data == trainer.data
    scarfmt.train(scarfmt.load_capture(capture, hold_out=2))
    (first, said, folder), (second, default, nowhere) = trainer.given
    assert (len(first.test), said.iterations, folder) == (1, 3, tmp_path / "run")
    assert (len(second.test), default.minutes, nowhere) == (4, 60.0, None)
    with pytest.raises(InvalidInput, match="exclude each other"):
        scarfmt.train("no capture", scarfmt.TrainOptions(iterations=3, minutes=3))
