"""The raw captures that a stage reads."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pacmo_core.formats.base import Format, FormatError, RawSequence
from pacmo_core.formats.labels import find_sequences
from pacmo_core.formats.registry import FORMATS, check_setting_names
from stages.common.params import ParamsError, StageError, validate


def open_captures(section: str, name: str, settings: Mapping[str, Any]) -> Format:
    """Make a reader of the format that a section of ``params.yaml`` names.

    Parameters
    ----------
    section : that has the keys ``format`` and ``settings``

    Raises
    ------
    ParamsError
        If there is no such format, or a setting is unknown, missing or invalid.
    """
    try:
        check_setting_names(name, settings)
    except KeyError as fault:
        raise ParamsError(f"{section}.format", fault.args[0]) from fault
    except ValueError as fault:
        raise ParamsError(f"{section}.settings", str(fault)) from fault
    reader: Format = validate(FORMATS[name], dict(settings), f"{section}.settings")
    return reader


def find_captures(form: Format, raw: Path) -> list[RawSequence]:
    """List the captures of a folder, with what its ``captures.csv`` states.

    Raises
    ------
    StageError
        If that table is faulty.
    """
    try:
        return find_sequences(form, raw)
    except FormatError as fault:
        raise StageError(str(fault)) from fault
