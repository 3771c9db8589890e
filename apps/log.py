"""Structured logs: a line of words for a person, a JSON object a line for a machine."""

import json
import logging
from datetime import UTC, datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import TextIO

log = logging.getLogger("pacmo")
_MOST_BYTES, _FILES = 4_000_000, 3


class JsonLine(logging.Formatter):
    """One JSON object a record: time, level, what happened, and what came with it as ``facts``."""

    def format(self, record: logging.LogRecord) -> str:
        """Write one line."""
        line = {
            "at": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "event": record.getMessage(),
            **getattr(record, "facts", {}),
        }
        return json.dumps(line, default=str)


class _People(logging.StreamHandler[TextIO]):
    """Lines for people on stderr."""


def start_log(path: Path) -> None:
    """Write to stderr and to a file that is turned over before it grows large."""
    for handler in [h for h in log.handlers if isinstance(h, RotatingFileHandler | _People)]:
        log.removeHandler(handler)
        handler.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    file = RotatingFileHandler(path, maxBytes=_MOST_BYTES, backupCount=_FILES, encoding="utf-8")
    file.setFormatter(JsonLine())
    people = _People()
    people.setFormatter(logging.Formatter("pacmo: %(message)s"))
    log.addHandler(file)
    log.addHandler(people)
    log.propagate = False  # Prefect's console would say it twice
    log.setLevel(logging.INFO)


def tell(event: str, level: int = logging.INFO, **facts: object) -> None:
    """Log what happened, with its facts as fields of the JSON line."""
    log.log(level, event, extra={"facts": facts})
