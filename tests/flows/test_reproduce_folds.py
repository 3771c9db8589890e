"""Reference: the definition of folds and seeds, and the graph as DVC reads it."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from pacmo_core.project.stages import upstream_stages

ROOT = Path(__file__).parents[2]
ONCE = {"synthesise", "ingest", "cut", "augment", "split_variations", "pool_skeleton_prior"}
ONCE |= {"pool_pacmo", "report"}
ONCE_A_FOLD = {"split", "train_features", "react_oracle", "react_untrained", "evaluate_pacmo"}


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    """Lay out the project's pipeline for two folds and three seeds."""
    folder = tmp_path_factory.mktemp("runs")
    shutil.copy(ROOT / "dvc.yaml", folder)
    params = YAML(typ="safe").load(ROOT / "params.yaml")
    params["runs"] |= {"folds": [1, 2], "seeds": [1, 2, 3]}
    params["runs"]["priors"]["datasets"] = []  # no stage of reactions depends on these
    YAML(typ="safe").dump(params, folder / "params.yaml")
    dvc = [sys.executable, "-m", "dvc"]
    subprocess.run([*dvc, "init", "-q", "--no-scm"], cwd=folder, check=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield {name: set(upstream_stages([name])) for name in upstream_stages([])}


def fold_and_seed(stage):
    """Read the end of an address: ``(fold, seed)``, empty where the stage has none."""
    stem, _, made_of = stage.partition("@")
    numbers = [part for part in made_of.split("-") if part.isdigit()]
    fold, seed = (*numbers, "", "")[:2]
    return stem, fold, seed


def test_a_stage_runs_once_or_per_fold_or_per_fold_and_seed(graph):
    counts = {}
    for name in graph:
        stem, fold, seed = fold_and_seed(name)
        counts.setdefault(stem, set()).add((fold, seed))
    for stem, made in counts.items():
        wanted = 1 if stem in ONCE else 2 if stem in ONCE_A_FOLD else 6
        assert len(made) == wanted, stem


def test_no_fold_depends_on_another_and_no_seed_either(graph):
    for name, below in graph.items():
        _, fold, seed = fold_and_seed(name)
        for other in below - {name} if fold else ():
            _, other_fold, other_seed = fold_and_seed(other)
            assert other_fold in ("", fold), f"{name} depends on {other}"
            assert not seed or other_seed in ("", seed), f"{name} depends on {other}"


def test_all_folds_and_seeds_are_pooled(graph):
    assert {n for n in graph if n.startswith("react@")} <= graph["pool_pacmo"]
    assert graph["pool_pacmo"] <= graph["report"]
