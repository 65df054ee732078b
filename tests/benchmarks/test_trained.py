"""Trained files measured: what is trained once, goes on after a kill, and stands in one table with other formats."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from benchmarks import encoded, photos, report, trained, trained_ablations, trained_plan, trained_tables, truck
from benchmarks.pages import Shown
from benchmarks.trained_ablations import train_job
from benchmarks.trained_plan import BASES, STUDIES, plan_table, trainings
from benchmarks.trained_tables import PAGE, PLAN, ablation_tables, scene_tables
from reference_encoder.training.options import TrainOptions
from reference_encoder.training.run import train
from scarfmt.cli.train import train as train_command
from scarfmt.formats.export_ply import write_inria_ply
from tests.reference_encoder.training import captures

SHORT = ("--iterations", "6", "--seeds", "1", "--no-write")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return captures.own(tmp_path_factory.mktemp("capture"))


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report, "SHORT_RESULTS", tmp_path / "results")
    monkeypatch.setattr(encoded, "SCRATCH", tmp_path / "encoded")
    monkeypatch.setattr(trained_ablations, "SCRATCH", tmp_path / "trained")
    monkeypatch.setattr(photos, "flip_metric", lambda: None)


class Child:
    """A child that runs jobs here and remembers them; it fails the jobs that it was set to fail.

    Where it is `late`, the time of a job is over when its first iteration is done, however fast the machine.
    """

    def __init__(self, fails: str = "nothing", late: bool = False) -> None:
        self.ran: list[dict[str, Any]] = []
        self.fails, self.late = fails, late

    def __call__(self, **job: Any) -> dict[str, Any]:
        self.ran.append(job)
        if job["recipe"]["estimator"] == self.fails:
            raise subprocess.CalledProcessError(1, "child")
        given = {**job, "seconds": 0.0} if self.late else job
        return train_job(json.loads(json.dumps(given)))


def kept(tmp_path: Path, name: str) -> dict[str, Any]:
    document = json.loads((tmp_path / "results" / f"{name}.json").read_text())
    ((_, records),) = ((scene, records) for scene, records in document.items() if scene != "provenance")
    return dict(records)


@pytest.mark.parametrize("base", BASES)
def test_rows_of_a_study_are_different_trainings_and_a_training_is_done_once(base: str) -> None:
    """Rows of several studies that ask for the same share it; every seed of one row comes before the next seed."""
    every = trainings(list(STUDIES), base, {"iterations": 9}, 2)
    assert len({(one.options, one.recipe) for one in every}) == len({one.name for one in every}) == len(every)
    assert [one.options.seed for one in every] == sorted(one.options.seed for one in every)
    for name, study in STUDIES.items():
        assert len(trainings([name], base, {"iterations": 9}, 1)) == len(study.rows)
    for one in every:
        one.options.check()


def test_the_page_says_what_is_trained() -> None:
    """Rows that change have to be written there again: `--report` does."""
    assert Shown(str(PAGE.relative_to(report.REPOSITORY)), PLAN, PAGE).text().strip() == plan_table().strip()


def test_a_training_that_is_done_is_not_done_again_and_one_that_fails_keeps_back_no_other(
    capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = ["tiny", str(capture), *SHORT, "--studies", "estimator"]
    assert trained_ablations.main(said, Child("rotation")) == 1
    assert list(kept(tmp_path, "trained-ablations")) == [
        "rvq entropy=gru context=waves estimator=straight-through, seed 0"
    ]
    again = Child()
    assert trained_ablations.main(said, again) == 0
    assert [job["recipe"]["estimator"] for job in again.ran] == ["rotation"]
    (first, second) = kept(tmp_path, "trained-ablations").values()
    assert first["iterations"] == 6
    assert len(first["layers"]) == TrainOptions().layers
    assert second["layers"][-1]["psnr_db"] > 3
    assert "| rotation trick | 1 |" in capsys.readouterr().out
    assert trained_ablations.main(said, Child("everything")) == 0
    assert trained_ablations.main([*said, "--plan"]) == 0
    assert capsys.readouterr().out.count("done  rvq") == 2


def test_a_training_goes_on_in_slices_and_a_file_without_figures_is_only_measured(
    capture: Path, tmp_path: Path
) -> None:
    said = ["tiny", str(capture), *SHORT, "--studies", "lambda-ssim", "--slice-minutes"]
    few = trained_plan.Study("a sweep", STUDIES["lambda-ssim"].rows[:1], by_layer=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(STUDIES, "lambda-ssim", few)
        assert trained_ablations.main([*said, "9"], Child(late=True)) == 75
        (checkpoint,) = (tmp_path / "trained").rglob("checkpoint-*.pt")
        assert trained_ablations.main([*said, "9"], Child()) == 0
        (file,) = (tmp_path / "trained").rglob("scene.scar")
        assert not checkpoint.exists()
        before = kept(tmp_path, "trained-ablations")
        (tmp_path / "results" / "trained-ablations.json").unlink()
        assert trained_ablations.main([*said, "9"], Child()) == 0
    assert kept(tmp_path, "trained-ablations") == before
    ((record,),) = [list(before.values())]
    assert record["layers"][-1]["file_bytes"] == file.stat().st_size


def test_a_training_ends_with_the_command_that_started_it(capture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else the same command, called again after a kill, would find another training at work in its folder."""
    parents = iter([7, 7, 1])
    monkeypatch.setattr(trained_ablations.os, "getppid", lambda: next(parents))
    with pytest.raises(SystemExit, match="was killed"):
        train(trained.load_capture(capture), TrainOptions(iterations=4, layers=2), report=trained_ablations._Teller())


def record(size: int, psnr_db: float) -> dict[str, Any]:
    layers = [{"file_bytes": size * k, "psnr_db": psnr_db + k, "worst_psnr_db": 1.0, "ssim": 0.9} for k in (1, 2)]
    layers = [{**layer, "flip": None, "lpips": 0.25, "lpips_3dgs": None} for layer in layers]
    return {"photos": 3, "size": [48, 36], "anchors": 1000, "layers": layers}


def test_tables_have_means_of_seeds_and_no_study_of_one_row() -> None:
    """With the spread of the seeds; columns that nobody measured are left out; sweeps show all layers."""
    grid = {one.name: record(10_000, 20.0 + one.options.seed) for one in trainings(["grid"], "rvq", {}, 2)}
    text = ablation_tables({"tiny": grid})
    assert "| none | 2 | 10.0 | 21.50 | 20.0 | 0.0 | 22.50 | 0.50 | 0.9000 | – | 1,000 |" in text
    assert text.count("**") == 2
    # A row that lacks a seed is compared with those of the others that it has.
    del grid[next(one.name for one in trainings(["grid"], "rvq", {}, 2) if one.options.seed == 1)]
    text = ablation_tables({"tiny": grid})
    assert "| none | 1 | 10.0 | 21.00 | 20.0 | – | 22.00 | – | 0.9000 | – | 1,000 |" in text
    assert "| 2 |" not in text
    sweep = {one.name: record(10_000, 20.0) for one in trainings(["lambda-ssim"], "rvq", {}, 1)}
    text = ablation_tables({"tiny": sweep})
    assert text.count("**") == 2
    assert "|  | seeds | layers | kB | PSNR, dB | worst | SSIM | LPIPS |" in text
    assert "| 0.4 | 1 | 2 | 20.0 | 22.00 | 1.00 | 0.9000 | 0.2500 |" in text


def test_one_table_has_trained_files_and_a_model_in_other_formats(
    capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All measured on the same photos; figures of photos of another size do not stay beside them."""
    made = train(trained.load_capture(capture), TrainOptions(iterations=4, layers=2))
    (tmp_path / "a.scar").write_bytes(made.data)
    write_inria_ply(captures.scene(), tmp_path / "a.ply")
    said = ["bonsai", str(capture), "--no-write", "--formats", "--ply", str(tmp_path / "a.ply")]
    trained.main([*said, "--scar", f"four steps={tmp_path / 'a.scar'}", "--qualities", "30"])
    records = kept(tmp_path, "trained")
    kinds = [it["kind"] for it in records.values()]
    assert kinds[:3] == ["trained", "trained", "rival"]
    assert set(kinds[3:]) == {"post-hoc"}
    assert records["four steps, layer 2"]["iterations"] == 4
    assert records["four steps, layer 2"]["figures"]["file_bytes"] == len(made.data)
    # The photos show this very model.
    assert records["3DGS, .ply, layer 1"]["figures"]["psnr_db"] > 50
    assert records["3DGS, .ply, layer 1"]["figures"]["file_bytes"] == (tmp_path / "a.ply").stat().st_size
    told = capsys.readouterr().out
    assert "1 photos of 48×36 held out" in told
    assert told.index("four steps, 4 iterations") < told.index("encode --quality 30") < told.index("3DGS, .ply")
    assert "HAC++ low" in told
    trained.main([*said, "--qualities", "--resolution", "24"])
    assert list(kept(tmp_path, "trained")) == ["3DGS, .ply, layer 1"]
    whole = str(tmp_path / "a.scar")
    trained.main(["bonsai", str(capture), "--no-write", "--model", f"whole={whole}", "--post-hoc", f"coded={whole}"])
    assert [(it["name"], it["kind"]) for it in kept(tmp_path, "trained").values()] == [
        *[("whole", "model")] * 2,
        *[("coded", "post-hoc")] * 2,
    ]
    assert scene_tables({}) == ""
    assert set(trained_tables.BESIDE.values()) <= set(photos.SCENES)


def test_truck_is_trained_in_slices_then_measured(capture: Path, tmp_path: Path) -> None:
    """Each call does one thing and says by its exit code whether there is more; commands are such as are understood."""
    ran: list[Sequence[str]] = []
    target = tmp_path / "trained.scar"

    def start(command: Sequence[str]) -> int:
        ran.append(command)
        if command[2] == "scarfmt" and len(ran) == 3:
            target.write_bytes(b"x")
        return 75 if len(ran) < 3 else 0

    said = [str(capture), "--folder", str(tmp_path), "--slice-minutes", "8"]
    assert [truck.main(said, start) for _ in range(4)] == [75, 75, 75, 0]
    context = train_command.make_context("train", list(ran[0][4:]))
    assert (context.params["device"], context.params["slice_minutes"]) == ("cuda", 8.0)
    assert ran[0] == ran[1] == ran[2]
    assert trained._parser().parse_args(list(ran[3][3:])).scar == [f"trained={target}"]
    assert truck.main(said, lambda _command: 1) == 1
    target.unlink()
    ran.clear()
    assert truck.main([*said, "--until-done"], start) == 0
    assert len(ran) == 4
