"""The solver's settings and what a variation must keep within, out of ``params.yaml``."""

from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML

from pacmo_core.augmentation.filter import VariationLimits
from pacmo_core.interaction_mesh import Settings
from pacmo_core.project.workspace import CommandError


@dataclass(frozen=True)
class Solving:
    """What the section ``augment`` says of solving."""

    solver: Settings
    limits: VariationLimits


def read_solving(params: Path) -> Solving:
    """Read the section ``augment``.

    Raises
    ------
    CommandError
        If there is no such file or section, or it does not fit.
    """
    if not params.is_file():
        raise CommandError(f"no {params}: give --params, such as a params.yaml")
    section = (YAML(typ="safe").load(params) or {}).get("augment")
    if not isinstance(section, dict):
        raise CommandError(f"{params}: no section augment")
    try:
        return TypeAdapter(Solving).validate_python(section)
    except ValidationError as fault:
        first = fault.errors()[0]
        place = ".".join(map(str, ("augment", *first["loc"])))
        raise CommandError(f"{params}, {place}: {first['msg']}, got {first['input']!r}") from fault
