"""What weights were trained on, said beside what a command generates with them."""

from contextlib import suppress
from pathlib import Path

from pacmo_core.project.workspace import CommandError
from pacmo_core.store.files import StoreError
from pacmo_core.store.tables import ClipRecord, read_rows
from pacmo_core.store.weights import read_trained_on

_CLIPS = "clips.parquet"  # beside stored motions
_SCRIPTS = "scripts.json"  # beside the raw captures of the embedded default


def check_weights(weights: Path) -> None:
    """Refuse weights that do not exist, and say where weights come from.

    Raises
    ------
    CommandError
        If there is no such file.
    """
    if not weights.exists():
        raise CommandError(f"no {weights}: ./run trains those in models/; --weights names others")


def is_synthetic(file: Path, clip: str) -> bool | None:
    """Whether a capture is generated: its record or folder says so; None if neither does.

    Parameters
    ----------
    file : a raw capture, or the Parquet file of stored clips
    clip : name of a stored clip, or of a reaction to it; empty for a raw capture
    """
    if (file.parent / _SCRIPTS).is_file():
        return True
    name = clip.partition("#")[0]
    with suppress(StoreError, OSError):
        records = read_rows(file.parent / _CLIPS, ClipRecord)
        return next((record.synthetic for record in records if record.clip == name), None)
    return None


def trained_on_line(weights: Path, *, synthetic_capture: bool | None) -> str:
    """Say what weights were trained on, and what that means for the capture they are given.

    Parameters
    ----------
    weights : file of weights
    synthetic_capture : whether the capture is generated; None if nothing says
    """
    trained_on = read_trained_on(weights)
    if trained_on is None:
        return f"{weights} does not state what it was trained on"
    text = f"{weights} was trained on {trained_on}"
    if not trained_on.is_synthetic or synthetic_capture:
        return text
    if synthetic_capture is None:
        return f"{text}; how such weights do on recorded motion is not known"
    return f"{text}; this capture is recorded: the figures of the report do not apply to it"
