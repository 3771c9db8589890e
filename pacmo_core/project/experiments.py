"""Experiments: overlays of ``params.yaml``.

``params.yaml`` as committed is the only copy of the default parameters. Each
``experiments/NAME.yaml`` holds the values that differ from them, or from those of another
experiment that it names under ``from``.

DVC can compose parameters itself, with Hydra (``hydra.enabled``). This module stays because DVC
does so in ``dvc exp run`` alone, not in ``dvc repro`` or ``dvc status``; because it writes
``params.yaml`` without comments, which here are the documentation of the parameters; and because
``params.yaml`` would then be a generated file, and the defaults a second copy in a folder of
configurations.
"""

import os
import subprocess
from collections.abc import Iterable
from datetime import UTC, datetime
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from pacmo_core.data.names import nearest_names
from pacmo_core.project.outputs import ExpectedPriors, ExpectedRuns, remove_outputs
from pacmo_core.project.workspace import PARAMS, SAVED_PARAMS, CommandError
from pacmo_core.store.files import write_text

FOLDER = Path("experiments")
DEFAULT = "default"
DEFAULTS_COPY = SAVED_PARAMS / "default.yaml"  # of a project that is not under version control
BASE = "from"
CAPTURES = "${captures}"
CAPTURE_FOLDERS = (Path("data/captures"), Path("../shared/data"))


class ExperimentError(CommandError):
    """An experiment that does not exist or cannot be composed."""


def experiment_names() -> list[str]:
    """List the experiments, ``default`` first."""
    return [DEFAULT, *sorted(path.stem for path in FOLDER.glob("*.yaml") if path.stem != DEFAULT)]


def default_params() -> str:
    """Return the text of the last committed ``params.yaml`` that holds ``experiment: default``.

    Without git, as in a downloaded archive, it is a copy that is made of ``params.yaml`` when this
    is first called.

    Raises
    ------
    ExperimentError
        If there is no ``params.yaml`` with ``experiment: default``.
    """
    # A commit of the parameters of another experiment does not change the defaults.
    commits = _git("log", "--format=%H", "--", f"./{PARAMS}").split()
    for commit in ["HEAD", *commits]:
        text = _git("show", f"{commit}:./{PARAMS}")
        if text and experiment_of(text) == DEFAULT:
            return text
    if not DEFAULTS_COPY.exists() and PARAMS.exists():
        text = PARAMS.read_text(encoding="utf-8")
        if experiment_of(text) == DEFAULT:
            write_text(DEFAULTS_COPY, text)
    if DEFAULTS_COPY.exists():
        return DEFAULTS_COPY.read_text(encoding="utf-8")
    raise ExperimentError(
        f"no default parameters: neither git nor {PARAMS} has a {PARAMS} with experiment: {DEFAULT}"
    )


def compose_params(name: str) -> str:
    """Compose the text of ``params.yaml`` for an experiment, with the comments of the default.

    Raises
    ------
    ExperimentError
        If there is no such experiment, its file is not a mapping in YAML, it sets a key that the
        default does not have, it is based on itself, it trains skeleton priors on a dataset that it
        does not make, or its captures are not on this machine.
    """
    if name == DEFAULT:
        return default_params()
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 100
    params = _load(yaml, name, derived=())
    _resolve_captures(params)
    _check_datasets(params, name)
    text = StringIO()
    yaml.dump(params, text)
    return text.getvalue()


def use_experiment(name: str) -> Path | None:
    """Write the parameters of an experiment to ``params.yaml``.

    Parameters that were edited, by a person or by ``dvc exp run -S``, are saved first.

    Returns
    -------
    the file that holds the edited parameters; None if there were no edits

    Raises
    ------
    ExperimentError
        As ``compose_params``.
    """
    text = compose_params(name)
    saved = _save_edits(text)
    write_text(PARAMS, text)
    return saved


def remove_unused_outputs() -> list[Path]:
    """Remove outputs of folds, seeds and skeleton priors that ``params.yaml`` does not define.

    Returns
    -------
    what was removed

    Raises
    ------
    ExperimentError
        If there is no ``params.yaml``, it is not YAML, or it has no folds and seeds.
    """
    if not PARAMS.exists():
        raise ExperimentError(f"no {PARAMS}: pacmo use {DEFAULT} makes one")
    params = _load_mapping(YAML(typ="safe"), PARAMS)
    runs, augmented = params.get("runs"), params.get("augmented", {})
    keys = ("folds", "seeds")
    if not isinstance(runs, dict) or not all(isinstance(runs.get(key), list) for key in keys):
        raise ExperimentError(f"{PARAMS}: runs must have lists of folds and seeds; got {runs}")
    priors = runs.get("priors", {})
    names = (priors.get(key, []) for key in ("datasets", "splits", "models", "seeds"))
    expected = ExpectedRuns(
        folds=runs["folds"],
        seeds=runs["seeds"],
        models=[*runs["models"], *runs.get("variants", [])] if "models" in runs else None,
        augmented_folds=augmented.get("folds", []),
        augmented_seeds=augmented.get("seeds", []),
        priors=ExpectedPriors(*names),
    )
    return remove_outputs(PARAMS.parent, expected)


def experiment_of(text: str) -> str:
    """Return the name of the experiment in the text of a ``params.yaml``, or an empty string."""
    # The key stands at the top level; reading the whole file would take 50 ms.
    for line in text.splitlines():
        if line.startswith("experiment:"):
            return line.partition(":")[2].partition("#")[0].strip(" '\"")
    return ""


def _save_edits(new_text: str) -> Path | None:
    if not PARAMS.exists():
        return None
    text = PARAMS.read_text(encoding="utf-8")
    if text == new_text or _same_values(text, _composed(experiment_of(text))):
        return None
    SAVED_PARAMS.mkdir(parents=True, exist_ok=True)
    for path in SAVED_PARAMS.glob("*.yaml"):
        if path != DEFAULTS_COPY and path.read_text(encoding="utf-8") == text:
            return path
    path = SAVED_PARAMS / f"{datetime.now(UTC):%Y-%m-%dT%H%M%S.%f}.yaml"
    write_text(path, text)
    return path


def _composed(name: str) -> str:
    try:
        return compose_params(name)
    except ExperimentError:
        return ""  # an experiment that was removed, or whose captures are gone: save the parameters


def _same_values(text: str, other: str) -> bool:
    yaml = YAML(typ="safe")
    try:
        return bool(text == other or yaml.load(text) == yaml.load(other))
    except YAMLError:
        return False


def _load(yaml: YAML, name: str, derived: tuple[str, ...]) -> Any:
    """Load an experiment over its base; ``derived`` are the experiments that are based on it."""
    if name not in experiment_names():
        raise ExperimentError(
            f"no experiment {name}{_meant(name, experiment_names())}; "
            f"there are {', '.join(experiment_names())} in {FOLDER}/"
        )
    if name in derived:
        chain = f" {BASE} ".join((*derived, name))
        raise ExperimentError(f"{FOLDER}/{name}.yaml: circular base: {chain}")
    if name == DEFAULT:
        return yaml.load(default_params())
    overlay = _load_mapping(yaml, FOLDER / f"{name}.yaml")
    params = _load(yaml, overlay.pop(BASE, DEFAULT), (*derived, name))
    _override(params, overlay, where=name)
    return params


def _load_mapping(yaml: YAML, file: Path) -> Any:
    try:
        content = yaml.load(file)
    except YAMLError as fault:
        raise ExperimentError(f"{file}: not YAML: {' '.join(str(fault).split())}") from fault
    if not isinstance(content, dict):
        raise ExperimentError(f"{file}: wanted a mapping of parameters")
    return content


def _override(params: Any, overlay: Any, where: str) -> None:
    for key, value in overlay.items():
        if key not in params:
            meant = _meant(str(key), map(str, params))
            raise ExperimentError(f"{where}.{key}: the default {PARAMS} has no such key{meant}")
        # ``settings`` depend on the raw format, so those of another format replace them whole.
        if isinstance(params[key], dict) and isinstance(value, dict) and key != "settings":
            _override(params[key], value, f"{where}.{key}")
        else:
            params[key] = value


def _meant(name: str, known: Iterable[str]) -> str:
    nearest = nearest_names(name, known)
    return f" (did you mean {' or '.join(nearest)}?)" if nearest else ""


def _check_datasets(params: Any, name: str) -> None:
    """Refuse skeleton priors of a dataset of which the experiment makes no variations."""
    second = params.get("augment", {}).get("second_dataset", {})
    made = [params.get("ingest", {}).get("dataset")]
    made += [second["dataset"]] if second.get("format") else []
    datasets = params.get("runs", {}).get("priors", {}).get("datasets", [])
    unmade = [dataset for dataset in datasets if dataset not in made]
    if unmade:
        raise ExperimentError(
            f"{FOLDER}/{name}.yaml: runs.priors.datasets has {', '.join(unmade)}, of which there "
            f"will be no variations; wanted {' or '.join(made)}, or [] to train no skeleton priors"
        )


def _resolve_captures(params: Any) -> None:
    """Replace ``${captures}`` by the folder of captures, at every depth."""
    for key, value in params.items() if isinstance(params, dict) else enumerate(params):
        if isinstance(value, dict | list):
            _resolve_captures(value)
        elif isinstance(value, str) and value.startswith(CAPTURES):
            params[key] = _capture_folder(value)


def _capture_folder(raw: str) -> str:
    inside = raw.removeprefix(CAPTURES).lstrip("/")
    named = os.environ.get("PACMO_REAL_DATA")
    folders = [Path(named)] if named else list(CAPTURE_FOLDERS)
    for folder in folders:
        if (folder / inside).exists():
            return (folder / inside).as_posix()
    searched = " or ".join((folder / inside).as_posix() for folder in folders)
    raise ExperimentError(
        f"no captures in {searched}; docs/datasets.md says how to obtain them, and "
        "PACMO_REAL_DATA may name the folder that holds them"
    )


def _git(*words: str) -> str:
    """Output of git, empty if it fails or there is no git."""
    try:
        process = subprocess.run(["git", *words], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return ""
    return process.stdout if process.returncode == 0 else ""
