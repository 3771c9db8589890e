"""What is trusted: imports as the syntax trees show them, and DVC's own reading of dvc.yaml.

A stage depends on its module, on ``stages/common`` and on the packages of ``pacmo_core`` that it
imports, directly or through others: no more and no less. So an edit of a package runs again what
uses it, and nothing else.
"""

import ast
import shlex
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import networkx as nx
import pytest
from dvc.repo import Repo
from ruamel.yaml import YAML

from flows.nightly import trained_model
from pacmo_core.models import MODELS
from pacmo_core.project.experiments import compose_params, experiment_names

ROOT = Path(__file__).parents[1]
LAYERS = ("pacmo_core", "stages")
# The public face imports nothing until it is asked, so no stage depends on it.
LAZY = {"pacmo_core/__init__.py", "stages/__init__.py"}
TRAININGS = {
    *("train_features", "train_reaction", "train_pacmo_variant", "train_pacmo_augmented"),
    "train_skeleton_prior",
}


def read_stages() -> dict[str, dict[str, Any]]:
    """Read every stage of ``dvc.yaml``, of all models, also of PaCMO trained on variations."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        params = YAML(typ="safe").load(ROOT / "params.yaml")
        params["augmented"] |= {"folds": [1], "seeds": [1]}
        params["runs"]["models"] = ["pacmo", "pacmo_paper", "regression", "gru", "flow_matching"]
        params["runs"]["variants"] = list(params["train_pacmo_variants"])
        YAML(typ="safe").dump(params, folder / "params.yaml")
        shutil.copy(ROOT / "dvc.yaml", folder)
        Repo.init(name, no_scm=True).close()
        with Repo(name) as repo:
            return {
                stage.addressing.rpartition(":")[2]: {
                    "cmd": shlex.split(stage.cmd),
                    "deps": {d.def_path for d in stage.deps if not hasattr(d, "params")},
                    "params": {p for d in stage.deps if hasattr(d, "params") for p in d.params},
                    "outs": {out.def_path for out in stage.outs},
                }
                for stage in repo.index.stages
            }


STAGES = read_stages()


def kind(stage: str) -> str:
    """Name the stage without the values of its matrix."""
    return stage.partition("@")[0]


def module_file(module: str) -> Path | None:
    path = ROOT.joinpath(*module.split("."))
    if path.is_dir():
        main = path / "__main__.py"
        return main if main.exists() else path / "__init__.py"
    return path.with_suffix(".py") if path.with_suffix(".py").exists() else None


@cache
def imports(path: Path) -> frozenset[Path]:
    """List the project's files that a file imports, those for type checkers left out."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        id(child)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for child in ast.walk(node)
    }
    names = set()
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    files = {module_file(name) for name in names if name.split(".")[0] in LAYERS}
    return frozenset(file for file in files if file is not None)


def imported_below(stage: str) -> set[Path]:
    """List the project's files that running a stage runs."""
    command = STAGES[stage]["cmd"]
    files, waiting = set(), [module_file(command[2])]
    if "--model" in stage or any(word.startswith("--model=") for word in command):
        # The registry names a model's code as text and imports it when it is needed.
        name = next(w.partition("=")[2] for w in command if w.startswith("--model="))
        waiting += [module_file(MODELS[name].training.partition(":")[0])]
    while waiting:
        file = waiting.pop()
        files.add(file)
        waiting.extend(imports(file) - files)
    return files


def units(files: set[Path]) -> set[str]:
    """Name what ``dvc.yaml`` would name of files: packages, and modules beside packages."""
    relative = {file.relative_to(ROOT) for file in files}
    return {"/".join(path.parts[:2]) for path in relative} - LAZY


def code_of(stage: str) -> set[str]:
    return {dep for dep in STAGES[stage]["deps"] if dep.split("/")[0] in LAYERS}


@pytest.mark.parametrize("stage", STAGES)
def test_the_code_that_a_stage_imports_is_what_it_depends_on(stage):
    imported = units(imported_below(stage))
    assert imported - code_of(stage) == set(), "imported, and not among deps"
    assert code_of(stage) - imported - {"stages/common"} == set(), "among deps, and not imported"


def test_code_dependencies_are_packages_and_modules_beside_packages():
    for stage in STAGES:
        for dep in code_of(stage):
            assert dep.count("/") == 1, f"{stage}: {dep}"


PACKAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "pacmo_core").iterdir()
    if (path.is_dir() and path.name != "__pycache__") or path.suffix == ".py"
)
FEATURES, REACTION = "train_features", "train_reaction"
INFERENCE = {"react", "react_variant", "react_augmented", "react_without_finish"}
TRAIN_REACTION = {FEATURES, REACTION, "train_pacmo_variant", "train_pacmo_augmented"}
PRIORS = {"train_skeleton_prior", "evaluate_skeleton_prior"}
ALL = {kind(stage) for stage in STAGES}
# What an edit of a package runs again, before what depends on the outputs of these.
EDITED = {
    "pacmo_core/data": ALL - {"pool_skeleton_prior"},
    "pacmo_core/formats": {"synthesise", "ingest", "augment"},
    "pacmo_core/store": ALL,
    "pacmo_core/synthesis": {"synthesise", "react_oracle"},
    "pacmo_core/operators": {*TRAIN_REACTION, *INFERENCE, "react_untrained", "evaluate_pacmo"},
    "pacmo_core/training": {*TRAIN_REACTION, *INFERENCE, *PRIORS, "evaluate_pacmo"},
    "pacmo_core/models.py": {*TRAIN_REACTION, *INFERENCE, *PRIORS, "evaluate_pacmo", "report"},
    "pacmo_core/execution.py": {"ingest", "augment"},
    "pacmo_core/ingestion.py": {"ingest", "augment"},
    "pacmo_core/finish": {*TRAIN_REACTION, *INFERENCE, "react_untrained"},
    "pacmo_core/reaction": {*TRAIN_REACTION, *INFERENCE, "evaluate_pacmo"},
    "pacmo_core/interaction_mesh": {"augment", "evaluate_skeleton_prior"},
    "pacmo_core/augmentation": {"augment"},
    "pacmo_core/skeleton_prior": {*PRIORS, "split_variations"},
    "pacmo_core/metrics": {
        *("react_untrained", "evaluate_pacmo", "pool_pacmo", "evaluate_skeleton_prior", "report"),
    },
    "pacmo_core/figures": {"report"},
    "pacmo_core/api.py": set(),
    "pacmo_core/commands": set(),
    "pacmo_core/project": set(),
    "pacmo_core/promotion.py": set(),
}
NO_STAGE = {"pacmo_core/commands", "pacmo_core/project", "pacmo_core/promotion.py"}


def runs_again(package: str) -> set[str]:
    return {kind(stage) for stage in STAGES if package in code_of(stage)}


def test_an_edit_of_a_package_runs_again_what_uses_it():
    assert EDITED.keys() == {*PACKAGES} - {"pacmo_core/__init__.py"}
    assert {package: runs_again(package) for package in EDITED} == EDITED


@pytest.mark.parametrize("package", PACKAGES)
def test_an_edit_of_a_package_runs_a_training_again_only_if_the_training_imports_it(package):
    trainings = {
        stage
        for stage in STAGES
        if kind(stage) in TRAININGS and package in units(imported_below(stage))
    }
    named = {stage for stage in STAGES if kind(stage) in TRAININGS and package in code_of(stage)}
    assert named == trainings
    if package in NO_STAGE or package == "pacmo_core/metrics":
        assert not named


@pytest.mark.slow
def test_dvc_status_names_what_uses_a_package_after_an_edit_of_it(tmp_path, monkeypatch):
    """Commit made-up outputs, edit each package in turn, and ask DVC."""
    for name in ("dvc.yaml", "params.yaml"):
        shutil.copy(ROOT / name, tmp_path)
    for name in LAYERS:
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=ignore)
    (tmp_path / ".dvcignore").write_text("__pycache__/\n")
    monkeypatch.chdir(tmp_path)
    Repo.init(str(tmp_path), no_scm=True).close()
    with Repo(str(tmp_path)) as repo:
        paths = {path for stage in repo.index.stages for path in (*stage.deps, *stage.outs)}
        for path in sorted(p.def_path for p in paths if not hasattr(p, "params")):
            place = tmp_path / path
            if not place.exists():
                file = place if place.suffix else place / "content"
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(path)
        repo.commit(force=True)
        assert repo.status() == {}
        defined = {kind(stage.addressing) for stage in repo.index.stages}
    for package, expected in EDITED.items():
        path = tmp_path / package
        module = path if path.suffix else min(path.glob("[a-z]*.py"))
        text = module.read_text()
        module.write_text(f"{text}\n# edited\n")
        with Repo(str(tmp_path)) as repo:
            assert {kind(stage) for stage in repo.status()} == expected & defined, package
        module.write_text(text)


@pytest.mark.parametrize("stage", STAGES)
def test_every_path_that_a_stage_touches_is_on_its_command_line(stage):
    words = STAGES[stage]["cmd"][3:]
    paths = {word.rpartition("=")[2] for word in words if not word.startswith("-")}
    paths |= {word.partition("=")[2] for word in words if word.startswith("--variations=")}
    data = {dep for dep in STAGES[stage]["deps"] if dep.split("/")[0] not in LAYERS}
    touched = data | STAGES[stage]["outs"]
    numbers = {path for path in paths if path.isdecimal()}
    assert {path for path in paths - numbers if not is_below(path, touched)} == set()
    assert {path for path in touched if not is_below(path, paths)} == set()


def is_below(path: str, folders: set[str]) -> bool:
    return any(path == folder or path.startswith(f"{folder}/") for folder in folders)


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_reads_its_own_section_of_the_parameters(stage):
    command = STAGES[stage]["cmd"]
    models = [word.partition("=")[2] for word in command if word.startswith("--model=")]
    own = {kind(stage), command[2].rpartition(".")[2]}
    own |= {MODELS[name].section for name in models}
    own |= {MODELS[name].changes.partition(".")[0] for name in models}
    shared = {"experiment", "runs"} | ({"augment"} if "evaluate" in stage else set())
    # Which rows are finished, the limits beside measurements of variations, and whether PaCMO
    # continued from weights.
    shared |= {"react", "augment", "train_pacmo"} if stage == "report" else set()
    assert {param.partition(".")[0] for param in STAGES[stage]["params"]} <= own | shared


@pytest.mark.parametrize(
    "module", sorted((ROOT / "stages").glob("[a-z]*.py")), ids=lambda p: p.stem
)
def test_stages_do_not_import_each_other(module):
    others = {f for f in imports(module) if f.parent == ROOT / "stages" and f != module}
    assert {file.name for file in others} <= {"__init__.py"}


@pytest.mark.parametrize("name", experiment_names())
def test_an_experiment_sets_only_keys_of_params_yaml(name, monkeypatch, tmp_path):
    for folder in ("sbu", "duo_mocap", "cmu_18_19", "duetdance", "handover", "ntu/meta"):
        (tmp_path / folder).mkdir(parents=True)
    for which in ("", "120"):
        (tmp_path / f"ntu/meta/NTU_RGBD{which}_samples_with_missing_skeletons.txt").touch()
    monkeypatch.setenv("PACMO_REAL_DATA", str(tmp_path))
    monkeypatch.chdir(ROOT)
    assert f"experiment: {name}" in compose_params(name)


def test_dvc_yaml_and_its_lock_are_short():
    assert len((ROOT / "dvc.yaml").read_text().splitlines()) <= 400
    # Some ninety lines for each of fourteen trainings of skeleton priors, and PaCMO's settings.
    assert len((ROOT / "dvc.lock").read_text().splitlines()) <= 3650


def test_modules_are_few_and_few_of_them_are_small():
    folders = ("pacmo_core", "stages", "flows")
    lengths = [
        len(file.read_text(encoding="utf-8").splitlines())
        for folder in folders
        for file in (ROOT / folder).rglob("*.py")
    ]
    assert len(lengths) <= 269
    assert sum(length < 60 for length in lengths) <= 40


def test_no_module_of_the_library_imports_in_a_circle():
    files = {file for file in (ROOT / "pacmo_core").rglob("*.py") if file.name != "__init__.py"}
    graph = nx.DiGraph((file, other) for file in files for other in imports(file) & files)
    circles = [sorted(map(str, part)) for part in nx.strongly_connected_components(graph)]
    assert [circle for circle in circles if len(circle) > 1] == []


def test_the_stages_run_as_modules():
    for module in sorted({stage["cmd"][2] for stage in STAGES.values()}):
        assert module_file(module) is not None
    help_of = [sys.executable, "-m", "stages.train", "--help"]
    ended = subprocess.run(help_of, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "--model" in ended.stdout


@pytest.mark.parametrize("stage", sorted(name for name in STAGES if kind(name) in TRAININGS))
def test_retraining_by_model_finds_the_stage(stage: str) -> None:
    (model,) = (word for word in STAGES[stage]["cmd"] if word.startswith("--model="))
    assert trained_model(stage) == model.removeprefix("--model=")
