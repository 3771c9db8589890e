"""Read a stage's section of ``params.yaml`` into its dataclass; reject what does not fit."""

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any, ParamSpec, TypeVar, get_type_hints

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from pacmo_core.store.files import merge_params

PARAMS = Path("params.yaml")
EXPERIMENTS = Path("experiments")
Params = TypeVar("Params")
Arguments = ParamSpec("Arguments")


class StageError(ValueError):
    """An error that the user can correct: its text is one line and says how."""


class ParamsError(StageError):
    """A section of ``params.yaml`` with a missing, unknown or invalid value.

    Parameters
    ----------
    section : dotted, down to the setting if it is one
    reason : what was wanted and what was got
    path : the file
    """

    def __init__(self, section: str, reason: str, path: Path = PARAMS) -> None:
        super().__init__(f"{source_of(path)}, {section}: {reason}")


def read_params(
    section: str,
    kind: type[Params],
    path: Path = PARAMS,
    given: Mapping[str, object] = MappingProxyType({}),
    changes: str = "",
) -> Params:
    """Read one section; its keys must be those of the dataclass.

    Parameters
    ----------
    section : the stage's name, or a dotted path into another section
    kind : a dataclass; its fields are the section's keys, and those of ``given``
    path : the file
    given : values from the command line, such as the seed of a run
    changes : dotted path of values that replace some of the section's, at every depth

    Raises
    ------
    ParamsError
        If the section, a key or a value is missing, unknown or of the wrong type, or a key is
        given that the section has too.
    """
    params = _load(path)
    values = _section(params, section, path)
    if changes:
        values = merge_params(values, _section(params, changes, path))
    twice = sorted(given.keys() & set(values)) if given else []
    if twice:
        raise ParamsError(section, f"{', '.join(twice)} comes from the command line", path)
    values = {**values, **given} if given else values
    unknown = unknown_keys(values, kind)
    if unknown:
        raise ParamsError(section, f"unknown {', '.join(unknown)}", path)
    return validate(kind, values, section, path)


def validate(kind: type[Params], values: object, section: str, path: Path = PARAMS) -> Params:
    """Make a dataclass of values that a section of ``params.yaml`` has.

    Raises
    ------
    ParamsError
        If a value is missing or invalid.
    """
    try:
        return TypeAdapter(kind).validate_python(values)
    except ValidationError as fault:
        lines = [_in_words(error) for error in fault.errors()]
        raise ParamsError(section, "; ".join(lines), path) from fault


def _load(path: Path) -> Any:
    try:
        return YAML(typ="safe").load(path)
    except YAMLError as fault:
        raise StageError(f"{path}: not YAML: {' '.join(str(fault).split())}") from fault


def source_of(path: Path = PARAMS) -> str:
    """Name the file of parameters, with that of the experiment that they are of."""
    try:
        params = YAML(typ="safe").load(path)
    except (YAMLError, OSError):
        return str(path)
    name = params.get("experiment") if isinstance(params, Mapping) else None
    overlay = EXPERIMENTS / f"{name}.yaml"
    return f"{path} (of {overlay})" if overlay.is_file() else str(path)


def _section(values: Any, section: str, path: Path) -> Any:
    for key in section.split("."):
        if not isinstance(values, Mapping) or key not in values:
            raise ParamsError(section, "wanted a section of this name; there is none", path)
        values = values[key]
    return values


def _in_words(error: ErrorDetails) -> str:
    position = "".join(f"{part}." for part in error["loc"])[:-1]
    if error["type"] == "value_error":  # a dataclass's own check, which names the values
        return f"{position}: {error['ctx']['error']}" if position else str(error["ctx"]["error"])
    return f"{position}: {error['msg']}, got {error['input']!r}"


def unknown_keys(values: Any, kind: Any) -> list[str]:
    """List the keys, dotted, that are not fields of a dataclass or of one nested in it."""
    if not (is_dataclass(kind) and isinstance(values, Mapping)):
        return []
    known = {field.name for field in fields(kind)}
    types = get_type_hints(kind)
    nested = [
        f"{key}.{inner}"
        for key in known & set(values)
        for inner in unknown_keys(values[key], types[key])
    ]
    return sorted(set(values) - known) + sorted(nested)


@dataclass(frozen=True)
class PriorRuns:
    """The part ``priors`` of the section ``runs``: one model for each combination.

    Parameters
    ----------
    datasets : folders of variations, each of one skeleton
    splits : names of splits; with ``_foldK`` after one, the sources of fold K held out; with ``_N``
        after that, N samples to train on
    models : names in the registry
    seeds : of the training runs
    """

    datasets: list[str]
    splits: list[str]
    models: list[str]
    seeds: list[int]

    def groups(self) -> Iterator[tuple[str, str]]:
        """Yield each dataset and split on which models are compared."""
        return product(self.datasets, self.splits)


@dataclass(frozen=True)
class Runs:
    """The ``runs`` section of ``params.yaml``."""

    folds: list[int]
    seeds: list[int]
    models: list[str]
    variants: list[str]
    priors: PriorRuns


def read_prior_runs() -> PriorRuns:
    """Read the datasets, splits, models and seeds of the skeleton priors."""
    return read_params("runs", Runs).priors


@dataclass(frozen=True)
class SplitName:
    """``KIND``, ``KIND_foldK``, ``KIND_N`` or ``KIND_foldK_N``."""

    kind: str
    fold: int | None  # whose sources are held out; None: those that the parameters name
    samples: int | None  # to train on; None: all

    @property
    def pooled(self) -> str:
        """The name without the fold: folds are pooled."""
        return self.kind if self.samples is None else f"{self.kind}_{self.samples}"


def parse_split_name(name: str) -> SplitName:
    """Parse the name of a split of variations."""
    kind, samples = _number_after(name, "_")
    kind, fold = _number_after(kind, "_fold")
    return SplitName(kind, fold, samples)


def _number_after(name: str, mark: str) -> tuple[str, int | None]:
    """Split a number off the end of a name, if a mark is before it."""
    rest, _, number = name.rpartition(mark)
    return (rest, int(number)) if number.isdigit() else (name, None)


def run_stage(
    main: Callable[Arguments, None], *args: Arguments.args, **kwargs: Arguments.kwargs
) -> None:
    """Run a stage; report what the user can correct, and a full disk, in one line."""
    try:
        main(*args, **kwargs)
    except StageError as fault:
        sys.exit(str(fault))
    except OSError as error:
        if error.errno is None:  # not of the operating system
            raise
        sys.exit(f"{error.filename or 'a file'}: {error.strerror}")
