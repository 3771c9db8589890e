"""What weights were trained on. Truth: the records of the clips."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.commands.weights import find_weights, is_synthetic, trained_on_line
from pacmo_core.data.skeleton import SBU15
from pacmo_core.project.workspace import CommandError
from pacmo_core.reaction.inference import PACKAGED
from pacmo_core.store.files import StoreError
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import ClipRecord, write_rows
from pacmo_core.store.weights import TrainedOn, read_trained_on, read_weights, write_weights
from stages.report.__main__ import captures_text
from tests.reaction.problems import PACMO, clips
from tests.stages.training import FACTS

RECORDED = replace(FACTS, dataset="real", synthetic=False)


def test_package_names_the_weights_in_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_weights(Path("package")) == PACKAGED
    with pytest.raises(CommandError, match="no other: ./run trains those .* names others, or pack"):
        find_weights(Path("other"))
    Path("package").touch()
    assert find_weights(Path("package")) == Path("package"), "a file of this name comes first"
    line = trained_on_line(Path(os.path.relpath(PACKAGED)), synthetic_capture=None)
    assert line.startswith("the model in the package was trained on")


@pytest.mark.parametrize(
    ("records", "text"),
    [
        ([FACTS] * 3, "3 clips of toy, all synthetic"),
        ([RECORDED], "1 clip of real, recorded"),
        ([FACTS, RECORDED, RECORDED], "3 clips of real, toy, 1 of them synthetic"),
    ],
)
def test_training_clips_are_summarised_and_stated_by_the_weights(
    records: list[ClipRecord], text: str, tmp_path: Path
) -> None:
    facts = TrainedOn.of(records)
    assert str(facts) == text
    config = {"model": "pacmo", "trained_on": facts.to_dict()}
    write_weights(tmp_path / "w", config, {"x": torch.ones(1)})
    assert read_trained_on(tmp_path / "w") == facts
    line = trained_on_line(tmp_path / "w", synthetic_capture=False)
    assert f"was trained on {text}" in line
    assert ("this capture is recorded" in line) == (len(records) == 3 and records[1] is FACTS)
    assert "recorded:" not in trained_on_line(tmp_path / "w", synthetic_capture=True)
    assert "on recorded partners fewer" in trained_on_line(PACKAGED, synthetic_capture=None)
    unknown = trained_on_line(tmp_path / "w", synthetic_capture=None)
    assert "capture is recorded" not in unknown
    assert ("on recorded motion is not known" in unknown) == facts.is_synthetic


@pytest.mark.parametrize(
    "facts",
    [
        [],
        {"datasets": "default", "clips": 1, "synthetic_clips": 0},
        {"datasets": [], "clips": 1, "synthetic_clips": 2},
        {"datasets": [1], "clips": 1, "synthetic_clips": 0},
        {"clips": 1},
    ],
)
def test_a_statement_that_is_none_is_refused_by_file(facts: object, tmp_path: Path) -> None:
    config = {"model": "pacmo", "trained_on": facts}
    write_weights(tmp_path / "w", config, {"x": torch.ones(1)})
    with pytest.raises(StoreError, match="/w: not a complete file of weights"):
        read_trained_on(tmp_path / "w")


def test_a_capture_is_synthetic_if_its_record_or_its_folder_says_so(tmp_path: Path) -> None:
    rows = [replace(FACTS, clip="made"), replace(RECORDED, clip="real")]
    write_rows(tmp_path / "clips.parquet", ClipRecord, rows)
    motions = tmp_path / "motions.parquet"
    assert is_synthetic(motions, "made")
    assert is_synthetic(motions, "made#b#0")
    assert is_synthetic(motions, "real") is False
    assert is_synthetic(motions, "unlisted") is None
    assert is_synthetic(tmp_path / "x.bvh", "") is None
    (tmp_path / "scripts.json").write_text("{}")
    assert is_synthetic(tmp_path / "x.skeleton", "")


def test_react_names_what_its_weights_were_trained_on(tmp_path: Path) -> None:
    from pacmo_core.reaction import wgan  # noqa: PLC0415
    from pacmo_core.training.state import model_config, model_state  # noqa: PLC0415

    model = wgan.build_training(clips(4), replace(PACMO, n_epochs=2)).finish()
    facts = {"model": "pacmo", "config": model_config(model)}
    stated = {**facts, "trained_on": TrainedOn.of([FACTS] * 4).to_dict()}
    for name, config in (("silent", facts), ("stated", stated)):
        write_weights(tmp_path / name, config, model_state(model))
    folder = tmp_path / "clips"
    with write_motions(folder / "motions.parquet", SBU15) as writer:
        writer.add("one", clips(1)[0])
    words = ["react", str(folder / "motions.parquet"), "--clip", "one", "--person", "a"]
    words += ["--out", str(tmp_path / "o.parquet"), "--weights"]

    def said(name: str) -> str:
        done = CliRunner().invoke(app, [*words, str(tmp_path / name)])
        assert done.exit_code == 0, done.output
        return done.stdout

    assert "does not state what it was trained on" in said("silent")
    assert "all synthetic; how such weights do on recorded motion is not known" in said("stated")
    write_rows(folder / "clips.parquet", ClipRecord, [replace(RECORDED, clip="one")])
    assert "4 clips of toy, all synthetic; this capture is recorded" in said("stated")
    write_rows(folder / "clips.parquet", ClipRecord, [replace(FACTS, clip="one")])
    assert "all synthetic\n" in said("stated")


@pytest.mark.slow
def test_a_training_stage_states_its_clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from stages import train  # noqa: PLC0415
    from tests.stages.training import prepare  # noqa: PLC0415

    monkeypatch.chdir(tmp_path)
    prepare(tmp_path)
    command = ["train", "--model=regression", "--seed=1", "clips", "splits.parquet", "m", "c.csv"]
    monkeypatch.setattr("sys.argv", command)
    train.main(train.arguments())
    (file,) = Path("m").glob("*.safetensors")
    assert str(read_trained_on(file)) == "8 clips of toy, all synthetic"
    assert "trained_on" in read_weights(file)[0]
    shutil.rmtree("m")


def test_the_report_says_whether_captures_are_synthetic() -> None:
    for synthetic, text in ((0, "recorded"), (3, "synthetic: not evidence"), (1, "1 synthetic")):
        said = captures_text({"usable": 3, "synthetic": synthetic}, "")
        assert said.startswith(text) and said.endswith("all models below were trained on them")
    said = captures_text({"usable": 3, "synthetic": 0}, "w.safetensors")
    assert "; PaCMO continued on them from w.safetensors, the other models" in said
