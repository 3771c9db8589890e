"""Paths of a project's folder, the errors of its commands, and its log.

All paths are relative to the project's root, in which every command runs but ``./run pacmo``: that
stays in the user's folder, where the user's files are, and names the project's in
``PACMO_PROJECT``. Without the variable the present folder is the project's. The log is written
twice: a JSON object a line in ``history/log.jsonl``, a line of text on stderr.
"""

import json
import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from logging.handlers import RotatingFileHandler
from pathlib import Path
from typing import TextIO

from pacmo_core.data.limits import printable

PARAMS = Path("params.yaml")
DVC_YAML = Path("dvc.yaml")
DVC_LOCK = Path("dvc.lock")
DVC_CACHE = Path(".dvc/cache")
INBOX = Path("data/inbox")
QUARANTINE = Path("data/quarantine")
REASON_FILE = "reason.json"  # beside a capture in quarantine
METRICS = Path("reports/metrics.json")  # the figures that people compare
DETAILS = Path("reports/details.json")  # all figures, with intervals
REPORT = Path("reports/report.html")
PROMOTED_MODELS = Path("promoted")
HISTORY = Path("history")
RUNS = HISTORY / "runs"
DECISIONS = HISTORY / "decisions"
LOG = HISTORY / "log.jsonl"
LOCK = HISTORY / "writer.lock"
STAGE_LOGS = HISTORY / "stages"
STAGE_PROGRESS = HISTORY / "progress"
SAVED_PARAMS = HISTORY / "params"
INTAKE_PLAN = HISTORY / "intake.json"
STUDY = HISTORY / "study.json"
MEASUREMENTS = HISTORY / "measured.jsonl"
HISTORY_PAGE = HISTORY / "history.html"
REPORT_WITH_HISTORY = HISTORY / "report.html"
VARIATIONS_FOLDER = Path("data/variations")
MOTIONS = "motions.parquet"  # in every folder of clips

PROJECT_VARIABLE = "PACMO_PROJECT"

# Exit codes; 2, typer's and argparse's own, is wrong usage.
EXIT_FAILED, EXIT_REJECTED, EXIT_BUSY, EXIT_INTERRUPTED = 1, 3, 4, 130

# Number of a file descriptor to which events go as JSON lines, in place of text on stderr.
EVENTS_VARIABLE = "PACMO_EVENTS"

log = logging.getLogger("pacmo")
_MAX_BYTES, _N_FILES = 4_000_000, 3


class CommandError(Exception):
    """An error that the user can act on; its text is one line and says how."""


def require_project() -> None:
    """Check that the present folder is the project's: its commands would make one of any other.

    Raises
    ------
    CommandError
        If it holds neither ``dvc.yaml`` nor ``params.yaml``.
    """
    if not DVC_YAML.is_file() and not PARAMS.is_file():
        raise CommandError(f"no {DVC_YAML} in {Path.cwd()}: wanted the folder of the project")


def one_line(error: BaseException) -> str:
    """Return the text of an error on one line; of a ``KeyError`` the message without quotes.

    Control characters, which a name or a file may contain, are escaped.
    """
    if isinstance(error, OSError) and error.strerror:
        return printable(f"{error.filename or 'file'}: {error.strerror}")
    text = str(error.args[0] if isinstance(error, KeyError) and error.args else error)
    return printable(" ".join(text.split()) or type(error).__name__)


@contextmanager
def errors_in_one_line() -> Iterator[None]:
    """End the process with exit code 1 and one line on stderr on an expected error.

    Expected are ``CommandError`` and ``OSError``. Any other exception is a bug and keeps its
    traceback.
    """
    try:
        yield
    except (CommandError, OSError) as error:
        sys.stderr.write(f"pacmo: {one_line(error)}\n")
        raise SystemExit(EXIT_FAILED) from None


@contextmanager
def reading_errors_in_one_line() -> Iterator[None]:
    """As ``errors_in_one_line``, and also for the errors of file readers and of computations.

    These are ``ValueError``, ``KeyError``, numbers that overflow, and memory that does not suffice.
    """
    with errors_in_one_line():
        try:
            yield
        except (ValueError, KeyError, ArithmeticError, MemoryError) as error:
            raise CommandError(one_line(error)) from error


class JsonFormatter(logging.Formatter):
    """Format a record as one JSON object: time, level, event, and its ``facts`` as fields."""

    def format(self, record: logging.LogRecord) -> str:
        """Return one line."""
        line = {
            "at": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "event": record.getMessage(),
            **getattr(record, "facts", {}),
        }
        return json.dumps(line, default=str)


class _ConsoleHandler(logging.StreamHandler[TextIO]):
    """Text on stderr, or events for a parent process that shows them itself."""


def configure_logging(path: Path = LOG) -> None:
    """Log to stderr and to a file that is rotated at 4 MB; replaces earlier handlers."""
    for handler in list(log.handlers):
        if isinstance(handler, RotatingFileHandler | _ConsoleHandler):
            log.removeHandler(handler)
            handler.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    file = RotatingFileHandler(path, maxBytes=_MAX_BYTES, backupCount=_N_FILES, encoding="utf-8")
    file.setFormatter(JsonFormatter())
    log.addHandler(file)
    log.addHandler(_console_handler())
    log.propagate = False  # otherwise Prefect's console handler prints every line again
    log.setLevel(logging.INFO)


def _console_handler() -> _ConsoleHandler:
    descriptor = os.environ.get(EVENTS_VARIABLE)
    if descriptor:
        handler = _ConsoleHandler(
            os.fdopen(int(descriptor), "w", encoding="utf-8", buffering=1, closefd=False)
        )
        handler.setFormatter(JsonFormatter())
        return handler
    handler = _ConsoleHandler()
    handler.setFormatter(logging.Formatter("pacmo: %(message)s"))
    return handler


def log_event(event: str, level: int = logging.INFO, **facts: object) -> None:
    """Log an event in words, with its facts as fields of the JSON line."""
    log.log(level, event, extra={"facts": facts})


def in_project(path: Path) -> Path:
    """Return a path of the project: as it is where the command runs in the project's root."""
    root = os.environ.get(PROJECT_VARIABLE)
    return path if not root or Path(root).resolve() == Path.cwd() else Path(root) / path


def enter_project() -> None:
    """Change to the project's root, for a command that works on the whole of it."""
    os.chdir(os.environ.get(PROJECT_VARIABLE) or ".")
