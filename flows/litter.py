"""Files that a killed process had half written: ``.NAME.PID`` beside NAME, of nobody who lives."""

import re
from pathlib import Path

from apps.lock import PROC, lives
from apps.places import HISTORY, SHELF

PLACES = (
    *(Path("data"), Path("models"), Path("reports"), Path("checkpoints"), Path("live")),
    *(HISTORY, SHELF),
)
_PARTIAL = re.compile(r"\..+\.(\d+)")


def remove_litter() -> list[Path]:
    """Remove them, and say which they were."""
    if not PROC.is_dir():
        return []
    found = [path for place in PLACES for path in place.rglob(".*") if _is_litter(path)]
    for path in found:
        path.unlink()
    return found


def _is_litter(path: Path) -> bool:
    name = _PARTIAL.fullmatch(path.name)
    return name is not None and path.is_file() and not lives(int(name[1]))
