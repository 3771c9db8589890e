"""Raw formats by the names under which settings speak of them."""

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.cmu import Cmu
from pacmo_core.formats.duetdance import DuetDance
from pacmo_core.formats.expi import Expi
from pacmo_core.formats.interhuman import InterHuman
from pacmo_core.formats.ntu import Ntu
from pacmo_core.formats.raw import Format
from pacmo_core.formats.sbu import Sbu

# Each a frozen dataclass of settings with the methods of Format.
FORMATS: dict[str, type[Any]] = {
    "ntu": Ntu,
    "sbu": Sbu,
    "duetdance": DuetDance,
    "expi": Expi,
    "bvh": BvhPairs,
    "cmu": Cmu,
    "interhuman": InterHuman,
}


def open_format(name: str, settings: Mapping[str, Any]) -> Format:
    """Fix the settings of a format.

    Parameters
    ----------
    name : a key of ``FORMATS``
    settings : the fields of its class, those with a default optional

    Raises
    ------
    KeyError
        If there is no such format.
    ValueError
        If a setting is unknown, missing, or has a value that the format refuses.
    """
    if name not in FORMATS:
        raise KeyError(f"no format {name!r}; there are {', '.join(FORMATS)}")
    known = {field.name: field.default is MISSING for field in fields(FORMATS[name])}
    unknown = sorted(set(settings) - set(known))
    missing = [
        setting for setting, required in known.items() if required and setting not in settings
    ]
    if unknown or missing:
        raise ValueError(
            f"format {name} wants the settings {', '.join(known)}; "
            f"got unknown {unknown}, missing {missing}"
        )
    opened: Format = FORMATS[name](**settings)
    return opened
