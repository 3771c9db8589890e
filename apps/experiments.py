"""Experiments by name: ``default.yaml`` is whole, every other file says what differs from it.

Or from another that it names in ``from``.
"""

import os
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from apps.failure import CommandError
from apps.leftover_priors import WantedPriors
from apps.leftovers import Wanted, remove_leftovers
from pacmo_core.store.files import write_text

FOLDER = Path("experiments")
PARAMS = Path("params.yaml")
CAPTURES = "${captures}"
BASE = "from"
RUNS = ("folds", "seeds")
PRIORS = ("datasets", "splits", "models", "seeds")
PLACES = (Path("data/captures"), Path("../shared/data"))


class ExperimentError(CommandError):
    """An experiment that does not exist or cannot be composed."""


def experiment_names() -> list[str]:
    """List the experiments, ``default`` first."""
    names = sorted(path.stem for path in FOLDER.glob("*.yaml"))
    return sorted(names, key=lambda name: name != "default")


def compose(name: str) -> str:
    """Compose the text of ``params.yaml`` for an experiment, the comments of the default kept.

    Raises
    ------
    ExperimentError
        If there is no such experiment, it sets what the default does not know, it differs from
        itself, or its captures are not at hand.
    """
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 100
    params = _load(yaml, name, above=())
    _fill_in(params)
    text = StringIO()
    yaml.dump(params, text)
    return text.getvalue()


def _load(yaml: YAML, name: str, above: tuple[str, ...]) -> Any:
    """Load an experiment over what it differs from; ``above`` are those that differ from it."""
    if name not in experiment_names():
        raise ExperimentError(
            f"no experiment {name}; there are {', '.join(experiment_names())} in {FOLDER}/"
        )
    if name in above:
        raise ExperimentError(f"{name}.{BASE}: {' from '.join((*above, name))} has no beginning")
    own = yaml.load(FOLDER / f"{name}.yaml")
    if name == "default":
        return own
    params = _load(yaml, own.pop(BASE, "default"), (*above, name))
    _override(params, own, where=name)
    return params


def use(name: str, *, discard: bool) -> None:
    """Make ``params.yaml`` that of an experiment.

    Raises
    ------
    ExperimentError
        As ``compose``; or if ``params.yaml`` holds edits by hand and ``discard`` is false.
    """
    text = compose(name)
    if PARAMS.exists() and not discard:
        now = PARAMS.read_text(encoding="utf-8")
        if now != text and now not in _compositions():
            raise ExperimentError(
                f"{PARAMS} holds edits that no experiment has; keep them as "
                f"{FOLDER}/NAME.yaml, or give --discard to lose them"
            )
    write_text(PARAMS, text)
    tidy()


def tidy() -> list[Path]:
    """Remove the outputs of folds, seeds and skeleton priors that ``params.yaml`` does not want.

    Raises
    ------
    ExperimentError
        If there is no ``params.yaml``, or it has no folds and seeds.
    """
    if not PARAMS.exists():
        raise ExperimentError(f"no {PARAMS}: pacmo use NAME makes one")
    params = YAML(typ="safe").load(PARAMS)
    runs, augmented = params.get("runs"), params.get("augmented", {})
    if not isinstance(runs, dict) or not all(isinstance(runs.get(k), list) for k in RUNS):
        raise ExperimentError(f"{PARAMS}: wanted runs with lists of folds and seeds, got {runs}")
    augmented_folds, augmented_seeds = (augmented.get(key, []) for key in RUNS)
    named = runs.get("priors", {})
    priors = WantedPriors(*(named.get(key, []) for key in PRIORS))
    wanted = Wanted(runs["folds"], runs["seeds"], augmented_folds, augmented_seeds, priors)
    return remove_leftovers(PARAMS.parent, wanted)


def _compositions() -> Iterator[str]:
    for name in experiment_names():
        try:
            yield compose(name)
        except ExperimentError:
            continue  # its captures are not at hand, so params.yaml cannot hold it


def _override(params: Any, changes: Any, where: str) -> None:
    for key, value in changes.items():
        if key not in params:
            raise ExperimentError(f"{where}.{key}: {FOLDER}/default.yaml has no such key")
        # ``settings`` belong to the raw format, so another format's replace them whole.
        if isinstance(params[key], dict) and isinstance(value, dict) and key != "settings":
            _override(params[key], value, f"{where}.{key}")
        else:
            params[key] = value


def _fill_in(params: Any) -> None:
    """Put the folder of captures for ``${captures}`` wherever it stands."""
    for key, value in params.items() if isinstance(params, dict) else enumerate(params):
        if isinstance(value, dict | list):
            _fill_in(value)
        elif isinstance(value, str) and value.startswith(CAPTURES):
            params[key] = _resolve(value)


def _resolve(raw: str) -> str:
    """Find the folder of captures."""
    inside = raw.removeprefix(CAPTURES).lstrip("/")
    named = os.environ.get("PACMO_REAL_DATA")
    places = [Path(named)] if named else list(PLACES)
    for place in places:
        if (place / inside).exists():
            return (place / inside).as_posix()
    looked = " or ".join((place / inside).as_posix() for place in places)
    raise ExperimentError(
        f"no captures in {looked}; docs/datasets.md says how to obtain them, and PACMO_REAL_DATA "
        "may name the folder that holds them"
    )
