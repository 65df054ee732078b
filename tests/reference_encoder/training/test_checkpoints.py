"""Checkpoints: what was saved comes back, whatever ended the process or damaged the disk."""

from __future__ import annotations

import io
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch

from reference_encoder.training import checkpoints
from reference_encoder.training.checkpoints import (
    discard_checkpoints,
    identity,
    last_iteration,
    load_checkpoint,
    save_checkpoint,
)
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.recipe import Recipe
from scarfmt.errors import InputWarning, InvalidInput
from tests.conftest import REPOSITORY

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
    assert found is not None
    assert found[0] == 1200
    assert torch.equal(found[1]["model"]["anchors"], saved["model"]["anchors"])
    assert found[1]["model"]["anchors"].dtype == torch.float64
    assert torch.equal(found[1]["model"]["open"], saved["model"]["open"])
    assert torch.equal(found[1]["random"], saved["random"])
    assert found[1]["optimiser"][0] == saved["optimiser"][0]


def test_the_last_two_are_kept(tmp_path: Path) -> None:
    for iteration in (5, 10, 100, 99_999_999):
        save_checkpoint(tmp_path, iteration, state(iteration), WHOSE)
    assert names(tmp_path) == ["checkpoint-00000100.pt", "checkpoint-99999999.pt"]
    assert last_iteration(tmp_path) == 99_999_999
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
    assert found is not None
    assert found[0] == 5
    (tmp_path / "checkpoint-00000005.pt").write_bytes(b"x")
    with pytest.raises(InvalidInput, match="input-checkpoint"), pytest.warns(InputWarning):
        load_checkpoint(tmp_path, WHOSE)


def test_another_trainings_checkpoint_is_not_gone_on_from(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, 5, state(1), WHOSE)
    with pytest.raises(InvalidInput, match="another capture, with other options or by another version"):
        load_checkpoint(tmp_path, "others")


def test_nothing_in_a_checkpoint_is_run(tmp_path: Path) -> None:
    """A file with a right digest and a pickle that would call something is refused by torch."""

    class Evil:
        def __reduce__(self) -> Any:
            return os.mkdir, (str(tmp_path / "made"),)

    save_checkpoint(tmp_path, 5, state(1), WHOSE)
    buffer = io.BytesIO()
    torch.save({"whose": WHOSE, "iteration": 5, "state": Evil()}, buffer)
    content = buffer.getvalue()
    digest = checkpoints.hashlib.sha256(content).digest()
    (tmp_path / "checkpoint-00000005.pt").write_bytes(checkpoints._MAGIC + digest + content)
    with pytest.raises(pickle.UnpicklingError):
        load_checkpoint(tmp_path, WHOSE)
    assert not (tmp_path / "made").exists()


_KILLED = """
import os, signal, sys
from pathlib import Path
import torch
from reference_encoder.training.checkpoints import save_checkpoint
folder = Path(sys.argv[1])
save_checkpoint(folder, 5, {"a": torch.ones(4)}, "w")
# Killed with the new file half on the disk, before it has its name.
os.fsync = lambda _number: os.kill(os.getpid(), signal.SIGKILL)
save_checkpoint(folder, 10, {"a": torch.zeros(4)}, "w")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_a_kill_half_way_leaves_the_one_before(tmp_path: Path) -> None:
    env = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run([sys.executable, "-c", _KILLED, str(tmp_path)], env=env, capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    found = load_checkpoint(tmp_path, "w")
    assert found is not None
    assert found[0] == 5
    save_checkpoint(tmp_path, 10, {"a": torch.zeros(4)}, "w")
    assert [name for name in names(tmp_path) if name.endswith(".part")] == []


def test_an_identity_is_that_of_all_options_and_of_the_capture() -> None:
    """The identity changes with a recipe in place of the preset's: what another recipe learnt cannot be continued."""

    class Some:
        digest = "abc"

    class Other:
        digest = "abd"

    options = [TrainOptions(), TrainOptions(seed=1), TrainOptions(lambda_=2.0), TrainOptions(minutes=3.0)]
    recipes = [Recipe(stages=4), Recipe(stages=4, estimator="straight-through")]
    every = [(capture, one, recipe) for capture in (Some(), Other()) for one in options for recipe in recipes]
    assert len({identity(*one) for one in every}) == len(every)  # type: ignore[arg-type]


def test_an_identity_is_that_of_the_layout_of_states(monkeypatch: pytest.MonkeyPatch) -> None:
    """A version whose states have other parts goes on from none of another's: it would miss some."""

    class Some:
        digest = "abc"

    before = identity(Some(), TrainOptions(), Recipe())  # type: ignore[arg-type]
    monkeypatch.setattr(checkpoints, "_LAYOUT", checkpoints._LAYOUT + 1)
    assert identity(Some(), TrainOptions(), Recipe()) != before  # type: ignore[arg-type]
