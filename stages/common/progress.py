"""Progress of a running stage, for the flow that runs it."""

import json
import os
import time
from pathlib import Path

from pacmo_core.store.files import write_text

PROGRESS = "PACMO_PROGRESS"  # environment variable: the file that progress is written to
_INTERVAL_S = 0.5  # at least between two writes


class Progress:
    """Writes ``{"done", "total", "unit"}`` as JSON to the file that ``PACMO_PROGRESS`` names.

    Without that variable it does nothing. The flow that runs the stages reads the file.
    """

    def __init__(self, total: int, unit: str) -> None:
        self._total, self._unit = total, unit
        self._written = 0.0
        name = os.environ.get(PROGRESS)
        self._file = Path(name) if name else None

    def update(self, done: int) -> None:
        """Write how many are done."""
        now = time.monotonic()
        if self._file is None or (done < self._total and now - self._written < _INTERVAL_S):
            return
        self._written = now
        state = {"done": done, "total": self._total, "unit": self._unit}
        write_text(self._file, json.dumps(state))
