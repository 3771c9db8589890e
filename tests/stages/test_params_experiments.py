"""What is trusted: what the paper prints of its training (4.2), and the readers of sections."""

import argparse
import importlib
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from pacmo_core.data.skeleton import DUET15, NTU25
from pacmo_core.data.variation_splits import SPLIT_METHODS
from pacmo_core.formats.registry import open_format
from pacmo_core.models import MODELS, model_names
from pacmo_core.operators.spectral import n_resolved_modes
from pacmo_core.operators.uno import U_SHAPE_RATIOS, UnoConfig, u_shape_channels
from pacmo_core.project.experiments import compose_params, default_params, experiment_names
from pacmo_core.store.files import file_hash
from stages.common.params import Runs, parse_split_name, read_params
from stages.train import read_settings

ROOT = Path(__file__).parents[2]
SEEDED = ("train_pacmo", "train_regression", "train_gru")
GIVEN = {name: {"random_seed": 1} for name in SEEDED} | {
    "train_skeleton_prior": {"random_seed": 1, "model": "kinematic"}
}
FULL = {"ntu": (NTU25, 21), "duetdance": (DUET15, 15)}


@pytest.fixture(autouse=True)
def captures(tmp_path, monkeypatch):
    """Put empty folders in the place of captures."""
    for folder in ("sbu", "duo_mocap", "cmu_18_19", "duetdance", "handover", "ntu/meta"):
        (tmp_path / folder).mkdir(parents=True)
    for which in ("", "120"):
        (tmp_path / f"ntu/meta/NTU_RGBD{which}_samples_with_missing_skeletons.txt").touch()
    monkeypatch.setenv("PACMO_REAL_DATA", str(tmp_path))
    monkeypatch.chdir(ROOT)


def sections() -> list[str]:
    """Name the stages that have a section, as the default knows them."""
    params = YAML(typ="safe").load(default_params())
    return [name for name in params if (ROOT / "stages" / f"{name}.py").exists()]


@pytest.mark.parametrize("name", experiment_names())
def test_every_stage_reads_its_section_of_an_experiment(name, tmp_path):
    (tmp_path / "params.yaml").write_text(compose_params(name))
    for section in sections():
        kind = importlib.import_module(f"stages.{section}").Params
        given = GIVEN.get(section, {})
        assert read_params(section, kind, tmp_path / "params.yaml", given) is not None


@pytest.mark.parametrize("name", experiment_names())
def test_the_priors_of_an_experiment_are_known(name, tmp_path):
    (tmp_path / "params.yaml").write_text(compose_params(name))
    priors = read_params("runs", Runs, tmp_path / "params.yaml").priors
    assert set(priors.models) <= set(model_names("skeleton_prior"))
    assert {parse_split_name(split).kind for split in priors.splits} <= set(SPLIT_METHODS)


def test_every_variant_of_pacmo_changes_its_settings_and_is_a_model(tmp_path):
    (tmp_path / "params.yaml").write_text(compose_params("default"))
    params = YAML(typ="safe").load(tmp_path / "params.yaml")
    variants = [model for model in MODELS.values() if model.changes]
    assert {model.name for model in variants} == set(params["train_pacmo_variants"])
    assert set(params["runs"]["variants"]) <= set(params["train_pacmo_variants"])
    paths = argparse.Namespace(seed=1, variations=None)
    found = [read_settings(MODELS["pacmo"], paths)]
    found += [read_settings(model, paths) for model in variants]
    assert len({str(settings) for settings in found}) == 1 + len(variants)
    changed = read_settings(MODELS["no_augmentation"], paths)
    assert changed.augmentation.min_rate == 1.0 and changed.n_critic == 1


@pytest.mark.parametrize("name", experiment_names())
def test_an_experiment_continues_from_weights_that_are_there(name):
    start = YAML(typ="safe").load(compose_params(name))["train_pacmo"]["start"]
    assert not start["weights"] or file_hash(ROOT / start["weights"]) == start["sha256"]


@pytest.mark.parametrize("name", FULL)
def test_the_full_experiments_are_the_papers(name):
    params = YAML(typ="safe").load(compose_params(name))
    skeleton, n_joints = FULL[name]
    assert len(skeleton.without(params["ingest"]["drop_joints"]).joints) == n_joints
    assert open_format(params["ingest"]["format"], params["ingest"]["settings"]) is not None
    for section in ("train_autoencoder", "train_regression", "train_gru"):
        assert params[section]["learning_rate"] == 1e-4
    for section in ("train_pacmo", "train_pacmo_paper"):
        rates = [params[section][network]["learning_rate"] for network in ("generator", "critic")]
        assert rates == [1e-4, 1e-4]
    for section in (*SEEDED, "train_pacmo_paper", "train_autoencoder"):
        assert params[section]["n_epochs"] == 200
        assert params[section]["halve_learning_rate_every"] == 50
    assert params["split"]["method"] == "clip"
    assert params["split"]["test_share"] == 0.2
    assert (params["train_gru"]["hidden"], params["train_gru"]["n_layers"]) == (200, 5)


def test_the_priors_of_the_papers_size_train_as_its_supplement_says():
    params = YAML(typ="safe").load(compose_params("variations_paper"))["train_skeleton_prior"]
    said = {"hidden": 256, "batch_size": 32, "learning_rate": 1e-3, "n_epochs": 50}
    assert {key: params[key] for key in said} == said
    assert params["halve_learning_rate_every"] >= params["n_epochs"]


@pytest.mark.parametrize("name", FULL)
def test_no_mode_of_the_full_experiments_is_cut_off_by_a_grid(name):
    params = YAML(typ="safe").load(compose_params(name))["train_pacmo"]
    uno = UnoConfig(
        in_channels=1,
        out_channels=1,
        lifting=params["width"],
        channels=u_shape_channels(params["width"]),
        modes=tuple(params["modes"]),
        ratios=U_SHAPE_RATIOS,
        n_points=params["n_points"],
        period=params["period"],
        skips=True,
    )
    assert uno.n_latent == 80
    grids = [uno.n_latent, *uno.sizes]
    for n_modes, pair in zip(uno.modes, pairwise(grids), strict=True):
        assert n_modes <= n_resolved_modes(min(pair))


@pytest.mark.parametrize("stage", sorted((ROOT / "stages").glob("[a-z]*.py")), ids=lambda p: p.stem)
def test_every_stage_reports_invalid_parameters_in_one_line(stage):
    assert stage.read_text().rpartition('if __name__ == "__main__":\n')[2].count("run_stage(") == 1


def test_an_invalid_parameter_is_one_line_without_a_traceback(tmp_path):
    (tmp_path / "params.yaml").write_text("cut: {clip_seconds: long}\n")
    command = [sys.executable, "-m", "stages.cut", "data/sequences", "data/clips"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 1
    assert ended.stderr.count("\n") == 1 and "clip_seconds" in ended.stderr
    assert "long" in ended.stderr
