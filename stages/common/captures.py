"""The raw captures that a stage reads."""

from pathlib import Path

from pacmo_core.formats.base import Format, FormatError, RawSequence
from pacmo_core.formats.labels import find_sequences
from stages.common.params import StageError


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
