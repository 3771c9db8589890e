"""What is trusted: the bytes of an uninterrupted training."""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from ruamel.yaml import YAML
from safetensors import safe_open
from torch import nn

from pacmo_core.store.files import StoreError, file_hash
from pacmo_core.store.weights import read_trained_on, read_weights, write_weights
from pacmo_core.training.checkpoints import Checkpoint, data_hash
from pacmo_core.training.devices import DeviceError, training_device
from pacmo_core.training.loop import TrainingLoop
from stages import train
from stages.common.files import read_curve
from stages.common.params import ParamsError, StageError
from stages.train import read_training_data
from tests.reaction.problems import clips
from tests.stages.training import SECTIONS, SEEDED, prepare

ROOT = Path(__file__).parents[2]
CLIPS, SPLITS = Path("clips"), Path("splits.parquet")
MODEL, CURVE = Path("models/m"), Path("curves/m.csv")
PATHS = (CLIPS, SPLITS, MODEL, CURVE)


@pytest.fixture(autouse=True)
def project(tmp_path, monkeypatch):
    """Stand in a folder with clips and parameters; undo what a stage asks of torch."""
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DVC_STUDIO_OFFLINE", "true")
    threads = torch.get_num_threads()
    yield tmp_path
    torch.use_deterministic_algorithms(mode=False)
    torch.set_num_threads(threads)


def change(section: str, **values: object) -> None:
    yaml = YAML(typ="safe")
    params = yaml.load(Path("params.yaml"))
    params[section].update(values)
    yaml.dump(params, Path("params.yaml"))


def facts_of(weights: Path) -> dict[str, object]:
    with safe_open(weights, framework="pt") as file:
        return json.loads(file.metadata()["config"])


def run(stage: str) -> None:
    paths = dict(zip(("clips", "splits", "model", "curve"), PATHS, strict=True))
    name = stage.removeprefix("train_")
    seed = 1 if stage in SEEDED else None
    options = {"seed": seed, "variations": None, "share": None}
    train.main(argparse.Namespace(**paths, **options, model_name=name))


def outputs() -> list[bytes]:
    return [(MODEL / "weights.safetensors").read_bytes(), CURVE.read_bytes()]


def kill_after_a_checkpoint(stage: str) -> None:
    """Start a stage, and end it by SIGKILL once it has written a checkpoint."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    name = stage.removeprefix("train_")
    command = [
        sys.executable,
        "-m",
        "stages.train",
        f"--model={name}",
        "--seed=1",
        *map(str, PATHS),
    ]
    with subprocess.Popen(command, env=environment) as running:
        while not list(Path("checkpoints").glob("*.safetensors")):
            assert running.poll() is None, "it ended before there was a checkpoint"
            time.sleep(0.002)
        running.send_signal(signal.SIGKILL)
    assert running.returncode == -signal.SIGKILL
    assert not MODEL.exists()


@pytest.mark.slow
def test_a_stage_that_was_killed_and_started_again_writes_the_same_bytes():
    change("train_pacmo", n_epochs=40, checkpoint_every=4)
    kill_after_a_checkpoint("train_pacmo")
    (checkpoint,) = Path("checkpoints").iterdir()
    before = len(read_weights(checkpoint)[0]["curve"])
    assert 4 <= before < 40
    run("train_pacmo")
    resumed = outputs()
    assert not list(Path("checkpoints").iterdir())
    run("train_pacmo")
    assert resumed == outputs()


@pytest.mark.parametrize("stage", SECTIONS)
def test_weights_say_what_they_are_and_what_made_them(stage):
    run(stage)
    facts = facts_of(MODEL / "weights.safetensors")
    data = read_training_data(CLIPS, SPLITS)
    assert facts["model"] == stage.removeprefix("train_")
    assert facts["settings"]["n_epochs"] == SECTIONS[stage].n_epochs
    assert facts["data"] == {
        "train": data_hash(data.train),
        "validation": data_hash(data.validation),
    }
    assert facts["torch"] == torch.__version__.partition("+")[0]
    curve = read_curve(CURVE)
    assert curve["step"] == [1, 2, 3, 4, 5, 6]
    chosen = facts["selection"]
    assert chosen["score"] == pytest.approx(curve["validation"][chosen["epoch"] - 1], rel=1e-5)
    assert chosen["score"] == pytest.approx(
        min(value for value in curve["validation"] if value == value), rel=1e-5
    )


def test_a_model_that_is_not_there_is_one_line():
    with pytest.raises(ParamsError, match=r"runs.models: wanted some of .*gru.*; got pacmoo"):
        run("train_pacmoo")


def test_a_start_that_is_another_file_is_said_before_data_are_read(monkeypatch):
    def read(*_: object) -> None:
        raise AssertionError("the data were read")

    monkeypatch.setattr(train, "read_training_data", read)
    write_weights(Path("start.safetensors"), {"model": "pacmo"}, {"x": torch.zeros(1)})
    change("train_pacmo", start={"weights": "start.safetensors", "sha256": "0" * 64, "share": 0.25})
    with pytest.raises(StageError, match="start.safetensors: wanted the SHA-256 000"):
        run("train_pacmo")
    change("train_pacmo", start={"weights": "gone.safetensors", "sha256": "0" * 64, "share": 0.25})
    with pytest.raises(StageError, match="train_pacmo.start: .*gone.safetensors"):
        run("train_pacmo")


def test_what_the_weights_of_the_start_were_trained_on_counts():
    run("train_pacmo")
    first = read_trained_on(MODEL / "weights.safetensors")
    shutil.copy(MODEL / "weights.safetensors", "start.safetensors")
    sha256 = file_hash(Path("start.safetensors"))
    change("train_pacmo", start={"weights": "start.safetensors", "sha256": sha256, "share": 0.25})
    run("train_pacmo")
    assert first is not None
    assert read_trained_on(MODEL / "weights.safetensors") == first + first
    assert (first + first).clips == 2 * first.clips
    assert (first + first).datasets == first.datasets


@pytest.mark.parametrize("stage", ["train_autoencoder", "train_pacmo", "train_regression"])
def test_what_dvc_plots_draws_is_a_column_of_the_curve(stage):
    change("train_pacmo", bone_length_weight=1.0)
    run(stage)
    plots = YAML(typ="safe").load((ROOT / "dvc.yaml").read_text())["plots"]
    model = stage.removeprefix("train_")
    (names,) = (
        names
        for plot in plots
        for facts in plot.values()
        for file, names in facts["y"].items()
        if model in file
    )
    assert set(names) <= set(read_curve(CURVE))


def test_live_curves_hold_every_epoch_and_touch_nothing_else(project):
    run("train_gru")
    rows = (project / "live/models/m/plots/metrics/loss.tsv").read_text().splitlines()
    assert [row.split("\t")[0] for row in rows] == ["step", "1", "2", "3", "4", "5", "6"]
    assert json.loads((project / "live/models/m/metrics.json").read_text())["step"] == 6
    assert not list(project.rglob("dvc.yaml"))


def test_a_training_that_goes_on_draws_its_live_curve_whole(project, monkeypatch):
    change("train_gru", checkpoint_every=4)
    written = Checkpoint.write

    def write_and_stop(checkpoint: Checkpoint, fit: TrainingLoop[nn.Module]) -> None:
        written(checkpoint, fit)
        raise KeyboardInterrupt

    monkeypatch.setattr(Checkpoint, "write", write_and_stop)
    with pytest.raises(KeyboardInterrupt):
        run("train_gru")
    monkeypatch.setattr(Checkpoint, "write", written)
    run("train_gru")
    rows = (project / "live/models/m/plots/metrics/loss.tsv").read_text().splitlines()
    assert [row.split("\t")[0] for row in rows] == ["step", "1", "2", "3", "4", "5", "6"]
    assert read_curve(CURVE)["step"] == [1, 2, 3, 4, 5, 6]


def test_other_settings_data_or_code_do_not_go_on_from_a_checkpoint(monkeypatch):
    facts = {"settings": {"width": 8}, "data": "a"}
    names = {
        Checkpoint("train_gru", facts, "reaction").path,
        Checkpoint("train_pacmo", facts, "reaction").path,
        Checkpoint("train_gru", {**facts, "data": "b"}, "reaction").path,
        Checkpoint("train_gru", {"settings": {"width": 9}, "data": "a"}, "reaction").path,
    }
    assert Checkpoint("train_gru", facts, "reaction").path in names
    monkeypatch.setattr("pacmo_core.training.checkpoints.code_hash", lambda _: "other")
    names.add(Checkpoint("train_gru", facts, "reaction").path)
    assert len(names) == 5


def test_a_pickle_in_a_checkpoints_place_is_refused(tmp_path):
    torch.save({"weight": torch.zeros(1)}, tmp_path / "w.safetensors")
    with pytest.raises(StoreError, match="not a complete file of weights"):
        read_weights(tmp_path / "w.safetensors")


def test_a_loss_that_is_no_number_stops_the_stage_by_its_name_and_writes_no_weights():
    change("train_pacmo", generator={"learning_rate": 1e12, "betas": [0.0, 0.9]}, n_epochs=50)
    with pytest.raises(FloatingPointError, match=r"wgan: .*not finite; terms"):
        run("train_pacmo")
    assert not MODEL.exists()


def test_data_hashes_tell_clips_orders_and_sides_apart():
    one, other = clips(2)
    hashes = {data_hash(c) for c in ([one], [other], [one, other], [other, one], [one.swapped()])}
    assert len(hashes) == 5
    assert data_hash([one, other]) == data_hash(iter(clips(2)))


def test_tensors_that_a_checkpoint_holds_come_back_bit_for_bit(tmp_path):
    state = torch.Generator().manual_seed(3).get_state()
    values = {"random/state": state, "half": torch.rand(3, 5).half(), "n": torch.tensor(7.0)}
    write_weights(tmp_path / "c", {"curve": [{"loss": 0.1 + 0.2}]}, values)
    facts, read = read_weights(tmp_path / "c")
    assert facts["curve"][0]["loss"] == 0.1 + 0.2
    assert all(torch.equal(read[name], value) for name, value in values.items())
    assert all(read[name].dtype == value.dtype for name, value in values.items())


@pytest.mark.parametrize(
    ("device", "processes", "said"),
    [("tpu", 1, "must be auto, cpu or cuda; got 'tpu'"), ("cpu", 2, "torchrun started 2")],
)
def test_a_device_that_cannot_be_is_refused(device, processes, said, monkeypatch):
    monkeypatch.setenv("WORLD_SIZE", str(processes))
    with (
        pytest.raises(DeviceError, match=said),
        training_device(device, threads=1, multiprocess=False),
    ):
        pass


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU here")
def test_a_gpu_that_is_not_there_is_refused_and_auto_does_without():
    with (
        pytest.raises(DeviceError, match="torch finds none"),
        training_device("cuda", threads=1, multiprocess=True),
    ):
        pass
    with training_device("auto", threads=1, multiprocess=True) as found:
        assert found == "cpu"


def test_contradictory_settings_end_a_stage_in_one_line_before_data_are_read() -> None:
    change("train_pacmo", n_epochs=5, validate_from=90)
    command = [sys.executable, "-m", "stages.train", "--model=pacmo", "--seed=1"]
    command += ["none", "none", "m", "c.csv"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.count("\n") == 1
    assert "params.yaml, train_pacmo: validate_from" in ended.stderr
    assert "got validate_from 90, n_epochs 5" in ended.stderr
