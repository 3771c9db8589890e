"""A perceptual study in one SQLite file: what is shown, to whom, and what they said.

Nothing personal is kept: a participant is a random word. An answer is acknowledged once it is on
the disk, and the first to a place stands, however often it is sent.
"""

import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.store.schema import StoreError

REAL, GENERATED = "real", "generated"
_VERSION = 1
_PATIENCE_S = 30.0
_TABLES = """
CREATE TABLE items (
  item INTEGER PRIMARY KEY, kind TEXT NOT NULL CHECK (kind IN ('real', 'generated')),
  source TEXT NOT NULL, scene TEXT NOT NULL) STRICT;
CREATE TABLE shown (
  person TEXT NOT NULL, place INTEGER NOT NULL, item INTEGER NOT NULL REFERENCES items,
  PRIMARY KEY (person, place), UNIQUE (person, item)) STRICT, WITHOUT ROWID;
CREATE INDEX shown_items ON shown (item);
CREATE TABLE answers (
  person TEXT NOT NULL, place INTEGER NOT NULL, real INTEGER NOT NULL CHECK (real IN (0, 1)),
  PRIMARY KEY (person, place), FOREIGN KEY (person, place) REFERENCES shown) STRICT, WITHOUT ROWID;
"""


@dataclass(frozen=True)
class Item:
    """One clip of a study.

    Parameters
    ----------
    kind : ``real`` or ``generated``
    source : the captured clip that it is, or reacts to
    scene : what the player reads, as JSON
    """

    kind: str
    source: str
    scene: str


@dataclass(frozen=True)
class Candidate:
    """A clip as far as drawing goes: how often it has been shown."""

    item: int
    kind: str
    source: str
    times_shown: int


@dataclass(frozen=True)
class Answer:
    """One answer: who, where, of which clip of which kind, and whether it was taken for real."""

    person: str
    place: int
    item: int
    kind: str
    real: bool


def write_study(path: Path, items: Iterable[Item]) -> None:
    """Write a study that nobody has answered.

    Raises
    ------
    FileExistsError
        If the file exists: it may hold answers.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(exist_ok=False)
    with _open(path) as database:
        database.executescript(_TABLES)
        rows = [(item.kind, item.source, item.scene) for item in items]
        database.executemany("INSERT INTO items (kind, source, scene) VALUES (?, ?, ?)", rows)
        database.execute(f"PRAGMA user_version = {_VERSION}")


class Study:
    """An open study; its methods may be called from several threads.

    Parameters
    ----------
    path : the file

    Raises
    ------
    StoreError
        If it is not a study of this version.
    """

    def __init__(self, path: Path) -> None:
        if not path.exists():
            raise StoreError(f"{path}: no such study (pacmo study make)")
        self._lock = threading.Lock()
        self._database = sqlite3.connect(
            path, timeout=_PATIENCE_S, isolation_level=None, check_same_thread=False
        )
        try:
            (version,) = self._database.execute("PRAGMA user_version").fetchone()
        except sqlite3.DatabaseError as fault:
            raise StoreError(f"{path}: not a study ({fault})") from fault
        if version != _VERSION:
            raise StoreError(f"{path}: wanted a study of version {_VERSION}, got {version}")
        for setting in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
            self._database.execute(f"PRAGMA {setting}")

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def begin(self, person: str, draw: Callable[[Sequence[Candidate]], Sequence[int]]) -> int:
        """Lay out the clips for a new participant, as ``draw`` chooses; say how many."""
        with self._lock, self._all_or_nothing():
            chosen = draw(self._candidates())
            places = [(person, place, item) for place, item in enumerate(chosen)]
            self._database.executemany("INSERT INTO shown VALUES (?, ?, ?)", places)
        return len(chosen)

    def candidates(self) -> list[Candidate]:
        """List the clips, and how often each has been shown."""
        with self._lock:
            return self._candidates()

    def progress(self, person: str) -> tuple[int, list[int]]:
        """Say how many clips a participant has, and which places are answered."""
        with self._lock:
            (count,) = self._database.execute(
                "SELECT COUNT(*) FROM shown WHERE person = ?", (person,)
            ).fetchone()
            rows = self._database.execute(
                "SELECT place FROM answers WHERE person = ? ORDER BY place", (person,)
            ).fetchall()
        return count, [place for (place,) in rows]

    def scene(self, person: str, place: int) -> str | None:
        """Give the clip at a participant's place; None if there is none."""
        with self._lock:
            row = self._database.execute(
                "SELECT scene FROM shown JOIN items USING (item) WHERE person = ? AND place = ?",
                (person, place),
            ).fetchone()
        return row[0] if row else None

    def answer(self, person: str, place: int, *, real: bool) -> bool:
        """Keep an answer unless the place has one; say whether the place is the participant's."""
        with self._lock:
            self._database.execute(
                "INSERT OR IGNORE INTO answers SELECT person, place, ? FROM shown "
                "WHERE person = ? AND place = ?",
                (int(real), person, place),
            )
            row = self._database.execute(
                "SELECT 1 FROM answers WHERE person = ? AND place = ?", (person, place)
            ).fetchone()
        return row is not None

    def answers(self) -> list[Answer]:
        """List every answer."""
        with self._lock:
            rows = self._database.execute(
                "SELECT person, place, item, kind, real FROM answers JOIN shown USING (person, place) "
                "JOIN items USING (item) ORDER BY person, place"
            ).fetchall()
        return [Answer(*rest, bool(real)) for *rest, real in rows]

    def _candidates(self) -> list[Candidate]:
        rows = self._database.execute(
            "SELECT item, kind, source, (SELECT COUNT(*) FROM shown WHERE shown.item = items.item) "
            "FROM items ORDER BY item"
        )
        return [Candidate(*row) for row in rows]

    @contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")


@contextmanager
def _open(path: Path) -> Iterator[sqlite3.Connection]:
    database = sqlite3.connect(path)
    try:
        with database:
            yield database
    finally:
        database.close()
