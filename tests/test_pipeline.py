"""What is trusted: two clones of one commit, told nothing of each other."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

ROOT = Path(__file__).parents[1]
PRODUCTS = ("data", "models", "reports")


def run(folder: Path, *command: str) -> str:
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(folder),
    }
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def reproduce(folder: Path) -> Path:
    """Clone the work tree's tracked files and reproduce the smallest experiment."""
    run(ROOT, "git", "clone", "-q", str(ROOT), str(folder))
    # What is not committed yet is tested too.
    changed = run(ROOT, "git", "ls-files", "--modified", "--others", "--exclude-standard").split()
    for name in changed:
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes((ROOT / name).read_bytes())
    run(folder, sys.executable, "-m", "pacmo_core.commands.cli", "use", "smallest")
    run(folder, sys.executable, "-m", "dvc", "repro")
    return folder


# Tests that edit its parameters come after those that do not.
@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    return reproduce(tmp_path_factory.mktemp("one") / "clone")


def hashes(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for product in PRODUCTS
        for path in sorted((folder / product).rglob("*"))
        if path.is_file() and path.name != ".gitignore"
    }


@pytest.mark.scheduled
@pytest.mark.slow
def test_the_same_commit_reproduced_twice_gives_the_same_bytes(clone, tmp_path):
    one, two = map(hashes, (clone, reproduce(tmp_path / "clone")))
    assert {Path(name).suffix for name in one} >= {".parquet", ".json", ".html", ".safetensors"}
    assert one == two


@pytest.mark.slow
def test_there_is_then_nothing_to_do(clone):
    assert "up to date" in run(clone, sys.executable, "-m", "dvc", "repro")


@pytest.mark.slow
def test_the_metrics_hold_every_row(clone):
    metrics = json.loads((clone / "reports" / "details.json").read_text())
    assert metrics["data"]["usable"] == 44  # eleven actions of four pairs
    assert metrics["pacmo"]["rows"].keys() >= {
        *("real", "oracle", "pacmo", "pacmo_paper", "gru", "wrong_partner", "pacmo_permuted"),
        *(
            "mean",
            "nearest_neighbour",
            "nearest_neighbour_finished",
            "no_critic",
            "pacmo_augmented",
        ),
    }
    gained = metrics["pacmo"]["augmentation"]
    assert len(gained["each"]["f2id"]) == 1  # a fold
    assert "mean" in gained["clips"]["f2id"]
    assert gained["folds"] == {}  # one fold has no interval
    assert "Does augmentation improve PaCMO?" in (clone / "reports" / "report.html").read_text()
    for row in metrics["pacmo"]["rows"].values():
        for name in ("f2id", "mmd_a", "mmd_s", "diversity", "matching", "ape", "energy_score"):
            cell = row[name]  # with fewer than four pairs of people there is no interval
            assert set(cell) in ({"mean"}, {"mean", "low", "high"})
            assert cell.get("low", cell["mean"]) <= cell["mean"] <= cell.get("high", cell["mean"])


@pytest.mark.slow
def test_the_metrics_hold_both_tasks_of_the_priors_and_our_bones_are_exact(clone):
    found = json.loads((clone / "reports" / "details.json").read_text())["skeleton_prior"]
    for task in ("retargeting", "generation"):
        models = found[task]["default"]["random"]
        assert models.keys() == {"template", "start", "kinematic", "f_cnn"}
        assert set(models["kinematic"]["all"]["JPD"]) >= {"mean"}
        assert models["template"]["all"]["E_b_first"]["mean"] > 1e-6
        for role in ("first", "second"):
            assert models["kinematic"]["all"][f"E_b_{role}"]["mean"] < 1e-6


@pytest.mark.slow
def test_the_oracle_keeps_the_partner_and_changes_the_reaction(clone):
    data = clone / "data"
    oracle = pl.read_parquet(data / "reactions" / "1" / "oracle" / "1" / "motions.parquet")
    name = oracle["clip"][0]
    assert name.endswith("#a#0")
    drawn = oracle.filter(pl.col("clip") == name)
    real = pl.read_parquet(data / "clips" / "motions.parquet").filter(
        pl.col("clip") == name.removesuffix("#a#0")
    )
    partner, reaction = drawn["person_a"].to_numpy(), drawn["person_b"].to_numpy()
    assert (partner == real["person_b"].to_numpy()).all()
    apart = abs(reaction - real["person_a"].to_numpy()).max(axis=(1, 2))
    assert 0.001 < apart.mean() < 2.0


@pytest.mark.slow
def test_an_edit_of_a_parameter_runs_only_the_stages_that_depend_on_it(clone):
    params = clone / "params.yaml"
    params.write_text(params.read_text().replace("played_clips: 2", "played_clips: 1"))
    said = run(clone, sys.executable, "-m", "dvc", "repro")
    assert "Running stage 'report'" in said
    assert said.count("Running stage") == 1


@pytest.mark.scheduled
@pytest.mark.slow
def test_a_further_seed_trains_only_its_own_models(clone):
    params = clone / "params.yaml"
    params.write_text(params.read_text().replace("seeds: [1] ", "seeds: [1, 2] ", 1))
    said = run(clone, sys.executable, "-m", "dvc", "repro")
    ran = {line.split("'")[1] for line in said.splitlines() if line.startswith("Running stage")}
    assert ran == {
        *("train_reaction@gru-1-2", "train_reaction@regression-1-2"),
        *("train_reaction@pacmo-1-2", "train_reaction@pacmo_paper-1-2"),
        *("react@gru-1-2", "react@regression-1-2", "react@pacmo-1-2", "react@pacmo_paper-1-2"),
        *("train_pacmo_variant@no_critic-1-2", "react_variant@no_critic-1-2"),
        *("react_without_finish@gru-1-2", "react_without_finish@regression-1-2"),
        *("react_without_finish@pacmo-1-2", "react_without_finish@pacmo_paper-1-2"),
        *("evaluate_pacmo@1", "pool_pacmo", "report"),
    }
    models = clone / "models" / "1" / "gru"
    first, second = ((models / seed / "weights.safetensors").read_bytes() for seed in "12")
    assert first != second


@pytest.mark.slow
def test_an_experiment_without_skeleton_priors_ends_with_a_report(clone):
    params = clone / "params.yaml"
    params.write_text(params.read_text().replace("datasets: [default]", "datasets: []", 1))
    for name in ("scores", "samples"):  # as in a checkout that never trained any
        shutil.rmtree(clone / "data" / "priors" / name)
    said = run(clone, sys.executable, "-m", "dvc", "repro")
    assert "Running stage 'pool_skeleton_prior'" in said and "Running stage 'train" not in said
    details = json.loads((clone / "reports" / "details.json").read_text())
    assert details["skeleton_prior"]["generation"] == {}
