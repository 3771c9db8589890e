"""What is trusted: the rules of docs/architecture.md; imports as the syntax trees show them."""

import ast
import shlex
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from dvc.repo import Repo
from ruamel.yaml import YAML

from pacmo_core.models import MODELS
from pacmo_core.project.experiments import compose_params, experiment_names

ROOT = Path(__file__).parents[1]
FLOORS = ("pacmo_core", "stages")


def augmented(folder: Path) -> None:
    """Let stages that the default does not run, PaCMO's on variations, run in one fold."""
    params = YAML(typ="safe").load(ROOT / "params.yaml")
    params["augmented"] |= {"folds": [1], "seeds": [1]}
    YAML(typ="safe").dump(params, folder / "params.yaml")
    shutil.copy(ROOT / "dvc.yaml", folder)
    Repo.init(str(folder), no_scm=True).close()


def stages():
    """Read every stage of ``dvc.yaml``, templates filled in."""
    with TemporaryDirectory() as name:
        augmented(Path(name))
        with Repo(name) as repo:
            return facts_of(repo)


def facts_of(repo: Repo) -> dict[str, dict[str, Any]]:
    return {
        stage.addressing.rpartition(":")[2]: {
            "cmd": shlex.split(stage.cmd),
            "deps": {dep.def_path for dep in stage.deps if not hasattr(dep, "params")},
            "params": {name for dep in stage.deps if hasattr(dep, "params") for name in dep.params},
            "outs": {out.def_path for out in stage.outs},
        }
        for stage in repo.index.stages
    }


STAGES = stages()


def module_file(module: str) -> Path | None:
    """Find the project's file of a module; a package without code of its own has none."""
    path = ROOT.joinpath(*module.split("."))
    if path.is_dir():
        path = path / "__init__.py"
        return path if any(not isinstance(n, ast.Expr) for n in parse(path).body) else None
    return path.with_suffix(".py") if path.with_suffix(".py").exists() else None


def parse(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imported(path: Path) -> set[str]:
    """Name the modules that a file imports, and what it takes from packages."""
    tree = parse(path)
    unused = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    names = set()
    for node in ast.walk(tree):
        if node in unused:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in names if name.split(".")[0] in FLOORS}


def code_below(path: Path) -> set[Path]:
    """List the project's files that running a file runs, itself among them."""
    below, waiting = set(), [path]
    while waiting:
        file = waiting.pop()
        below.add(file)
        found = {module_file(name) for name in imported(file) | registered(below)} - {None} - below
        waiting.extend(found - set(waiting))
    return below


def registered(files: set[Path]) -> set[str]:
    """Name the modules that the registry imports for the packages that files are of."""
    if module_file("pacmo_core.models") not in files:
        return set()
    packages = {file.parent.name for file in files}
    rows = [row for row in MODELS.values() if row.package in packages]
    paths = {path for row in rows for path in (row.settings, row.training, row.reader, row.network)}
    return {path.partition(":")[0] for path in paths if path}


def code_named(deps: set[str]) -> set[Path]:
    """List the files of code among a stage's dependencies; a folder stands for all in it."""
    files = set()
    for dep in deps:
        path = ROOT / dep
        if dep.split("/")[0] in FLOORS:
            files |= {path} if path.suffix else set(path.rglob("*"))
    return {f for f in files if f.is_file() and "__pycache__" not in f.parts and not is_bare(f)}


def is_bare(path: Path) -> bool:
    """Say whether a file is an ``__init__.py`` that runs nothing, or a mark for type checkers."""
    if path.name == "py.typed":
        return True
    return path.name == "__init__.py" and all(isinstance(n, ast.Expr) for n in parse(path).body)


@pytest.mark.parametrize("name", STAGES)
def test_the_code_a_stage_runs_is_just_what_it_names_as_dependencies(name):
    stage = STAGES[name]
    assert stage["cmd"][:2] == ["python", "-m"]
    wanted = code_below(module_file(stage["cmd"][2]))
    named = code_named(stage["deps"])
    python = {file for file in named if file.suffix == ".py"}
    assert {str(f.relative_to(ROOT)) for f in wanted - named} == set(), "imported, not named"
    assert {str(f.relative_to(ROOT)) for f in python - wanted} == set(), "named, not imported"


@pytest.mark.parametrize("name", STAGES)
def test_every_path_a_stage_touches_is_on_its_command_line(name):
    stage = STAGES[name]
    paths = {word.rpartition("=")[2] for word in stage["cmd"][3:] if not word.startswith("-")}
    data = {dep for dep in stage["deps"] if dep.split("/")[0] not in FLOORS}
    assert {
        word for word in paths if not (covered(word, data) or covered(word, stage["outs"]))
    } == set()
    assert {path for path in data | stage["outs"] if not covered(path, paths)} == set()


def covered(path: str, by: set[str]) -> bool:
    return any(path == other or path.startswith(f"{other}/") for other in by)


@pytest.mark.parametrize("name", STAGES)
def test_a_stages_section_of_the_parameters_bears_its_name_or_is_named_to_it(name):
    command = STAGES[name]["cmd"]
    named = [w.partition("=")[2] for w in command if w.startswith("--section=")]
    # A module that runs as two stages, such as react, reads one section.
    own = named or [name.partition("@")[0], command[2].rpartition(".")[2]]
    found = {param.partition(".")[0] for param in STAGES[name]["params"]}
    assert found <= {*own, "experiment", "runs"}


@pytest.mark.parametrize(
    "module", sorted((ROOT / "stages").glob("[a-z]*.py")), ids=lambda p: p.stem
)
def test_stages_do_not_import_each_other(module):
    others = {name for name in imported(module) if name.startswith("stages.")}
    assert all(name.split(".")[1].startswith("_") for name in others)


def test_params_yaml_is_committed_with_the_default_experiment(monkeypatch):
    monkeypatch.chdir(ROOT)
    assert YAML(typ="safe").load(compose_params("default"))["experiment"] == "default"


@pytest.mark.parametrize("name", experiment_names())
def test_an_experiment_sets_only_what_the_default_knows(name, monkeypatch, tmp_path):
    if name != "default":
        changes = YAML(typ="safe").load(ROOT / "experiments" / f"{name}.yaml")
        assert changes["experiment"] == name
    for folder in ("sbu", "duo_mocap", "cmu_18_19", "duetdance", "ntu/meta"):
        (tmp_path / folder).mkdir(parents=True)
    for which in ("", "120"):
        (tmp_path / f"ntu/meta/NTU_RGBD{which}_samples_with_missing_skeletons.txt").touch()
    monkeypatch.setenv("PACMO_REAL_DATA", str(tmp_path))
    assert f"experiment: {name}" in compose_params(name)
