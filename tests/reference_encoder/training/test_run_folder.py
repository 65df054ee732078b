"""The folder of a training: a log without what happens again; checkpoints that come back, whatever damaged the disk."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

from reference_encoder import kept_values
from reference_encoder.training.options import DEVICES, Progress, TrainOptions
from reference_encoder.training.run_folder import (
    DRAFT,
    LOG,
    PLOT,
    RunLog,
    discard_checkpoints,
    identity,
    last_iteration,
    load_checkpoint,
    read_log,
    save_checkpoint,
    save_draft,
)
from scarfmt.errors import InputWarning, InvalidInput

PROGRESS = Progress(10, 100, 1.0, 9.0, "grow", 21.5, None, 1000, 4000, 0.25)


def test_lines_say_what_was_reported(tmp_path: Path) -> None:
    """NaN and infinity, which JSON lacks, are null."""
    with RunLog(tmp_path / "run") as found:
        found.note(PROGRESS, ssim=0.8)
        found.note(replace(PROGRESS, iteration=20, psnr=math.nan, seconds_left=math.inf))
    first, second = read_log(tmp_path / "run")
    assert (first["iteration"], first["psnr"], first["bytes"], first["phase"]) == (10, 21.5, None, "grow")
    assert first["ssim"] == 0.8
    assert (second["psnr"], second["seconds_left"]) == (None, None)


def test_lines_after_the_checkpoint_are_dropped(tmp_path: Path) -> None:
    """Half a line, on which the process was killed, is dropped, too."""
    with RunLog(tmp_path) as found:
        for iteration in (10, 20, 30):
            found.note(replace(PROGRESS, iteration=iteration))
    with (tmp_path / LOG).open("ab") as stream:
        stream.write(b'{"iteration": 4')
    with RunLog(tmp_path, iteration=20) as found:
        found.note(replace(PROGRESS, iteration=25))
    assert [entry["iteration"] for entry in read_log(tmp_path)] == [10, 20, 25]
    with RunLog(tmp_path):
        pass
    assert read_log(tmp_path) == []


def test_a_line_is_on_the_disk_at_once_and_a_plot_at_the_end(tmp_path: Path) -> None:
    with RunLog(tmp_path) as found:
        found.note(PROGRESS)
        assert len(read_log(tmp_path)) == 1
    with Image.open(tmp_path / PLOT) as picture:
        assert min(picture.size) > 300


WHOSE = "capture and options"


def state(value: float) -> dict[str, Any]:
    return {
        "model": {"anchors": torch.full((5, 3), value, dtype=torch.float64), "open": torch.tensor([True, False])},
        "optimiser": [{"step": 7, "lr": 0.1, "name": "offsets", "none": None}, [torch.arange(3)]],
        "random": torch.get_rng_state(),
    }


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_was_saved_comes_back(tmp_path: Path) -> None:
    """Tensors bit for bit with their types, and everything round them."""
    assert load_checkpoint(tmp_path / "none", WHOSE) is None
    saved = state(0.1)
    save_checkpoint(tmp_path / "run", 1200, saved, WHOSE)
    found = load_checkpoint(tmp_path / "run", WHOSE)
    assert found[0] == 1200
    assert torch.equal(found[1]["model"]["anchors"], saved["model"]["anchors"])
    assert found[1]["model"]["anchors"].dtype == torch.float64
    assert torch.equal(found[1]["model"]["open"], saved["model"]["open"])
    assert torch.equal(found[1]["random"], saved["random"])
    assert found[1]["optimiser"][0] == saved["optimiser"][0]


def test_the_last_two_are_kept(tmp_path: Path) -> None:
    """What a kill left of one that was being written goes, too."""
    for name in ("checkpoint-00000007.pt", DRAFT):
        (tmp_path / f".{name}.0123.part").write_bytes(b"half")
    for iteration in (5, 10, 100, 99_999_999):
        save_checkpoint(tmp_path, iteration, state(iteration), WHOSE)
    assert names(tmp_path) == ["checkpoint-00000100.pt", "checkpoint-99999999.pt"]
    assert last_iteration(tmp_path) == 99_999_999
    save_draft(tmp_path, b"whole")
    discard_checkpoints(tmp_path)
    assert last_iteration(tmp_path) is None
    assert names(tmp_path) == []


@pytest.mark.parametrize("damage", ["cut", "empty", "bit"])
def test_a_damaged_newest_one_is_passed_over_with_a_warning(tmp_path: Path, damage: str) -> None:
    for iteration in (5, 10):
        save_checkpoint(tmp_path, iteration, state(iteration), WHOSE)
    path = tmp_path / "checkpoint-00000010.pt"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes({"cut": data[:-9], "empty": b"", "bit": data}[damage])
    with pytest.warns(InputWarning, match=r"checkpoint-00000010\.pt is damaged"):
        found = load_checkpoint(tmp_path, WHOSE)
    assert found[0] == 5
    (tmp_path / "checkpoint-00000005.pt").write_bytes(b"x")
    with pytest.raises(InvalidInput, match="input-checkpoint"), pytest.warns(InputWarning):
        load_checkpoint(tmp_path, WHOSE)


def test_another_trainings_checkpoint_is_not_gone_on_from(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, 5, state(1), WHOSE)
    with pytest.raises(InvalidInput, match="another capture, with other options or by another version"):
        load_checkpoint(tmp_path, "others")


@pytest.mark.parametrize("content", [[], {}, {"whose": 1, "iteration": 5, "state": {}}, {"whose": WHOSE, "state": {}}])
def test_a_file_that_no_training_wrote_is_passed_over(tmp_path: Path, content: Any) -> None:
    """Though its digest is right. One that torch or pickle wrote is never looked into."""
    path = tmp_path / "checkpoint-00000005.pt"
    for data in (b"".join(kept_values.pack(content)), pickle.dumps(content)):
        path.write_bytes(data)
        with pytest.warns(InputWarning, match="damaged"), pytest.raises(InvalidInput, match="input-checkpoint"):
            load_checkpoint(tmp_path, WHOSE)


def test_an_identity_is_that_of_all_options_and_of_the_capture() -> None:
    """The identity changes with a recipe in place of the preset's: what another recipe learnt cannot be continued."""

    class Some:
        digest = "abc"

    class Other:
        digest = "abd"

    options = [TrainOptions(), TrainOptions(seed=1), TrainOptions(lambda_=2.0), TrainOptions(preset="rvq")]
    every = [(capture, one) for capture in (Some(), Other()) for one in options]
    every += [(Some(), TrainOptions(device=device)) for device in DEVICES]  # the same wherever it goes on
    assert len({identity(*one) for one in every}) == len(every) - len(DEVICES)  # type: ignore[arg-type]
