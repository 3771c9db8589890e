"""The SQLite file of a study: its tables and their rows."""

import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.store.files import StoreError

REAL, GENERATED = "real", "generated"
VERSION = 1
_TABLES = """
CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT, WITHOUT ROWID;
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
    source : name of the captured clip
    scene : JSON for the player
    """

    kind: str
    source: str
    scene: str


@dataclass(frozen=True)
class Candidate:
    """A clip and how often it has been shown, for sampling."""

    item: int
    kind: str
    source: str
    times_shown: int


@dataclass(frozen=True)
class Answer:
    """One answer: the participant, the place in the order, the clip, its kind, the verdict."""

    person: str
    place: int
    item: int
    kind: str
    real: bool


def write_study(path: Path, items: Iterable[Item], facts: Mapping[str, str]) -> None:
    """Write a new study.

    Parameters
    ----------
    facts : origin of the clips; never sent to participants

    Raises
    ------
    FileExistsError
        If the file exists: it may hold answers.
    StoreError
        If the disk is full.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o600, exist_ok=False)  # it will hold what people answered
    try:
        with closing(sqlite3.connect(path)) as database, database:
            database.executescript(_TABLES)
            rows = [(item.kind, item.source, item.scene) for item in items]
            database.executemany("INSERT INTO items (kind, source, scene) VALUES (?, ?, ?)", rows)
            database.executemany("INSERT INTO facts VALUES (?, ?)", facts.items())
            database.execute(f"PRAGMA user_version = {VERSION}")
    except sqlite3.Error as error:  # a full disk
        path.unlink()
        raise StoreError(f"{path}: the study cannot be written: {error}") from error


_LOCK_TIMEOUT_S = 30.0


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
            path, timeout=_LOCK_TIMEOUT_S, isolation_level=None, check_same_thread=False
        )
        try:
            (version,) = self._database.execute("PRAGMA user_version").fetchone()
        except sqlite3.DatabaseError as fault:
            raise StoreError(f"{path}: not a study ({fault})") from fault
        if version != VERSION:
            raise StoreError(f"{path}: wanted a study of version {VERSION}, got {version}")
        for setting in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
            self._database.execute(f"PRAGMA {setting}")

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def facts(self) -> dict[str, str]:
        """Return the origin of the clips."""
        with self._lock:
            return dict(self._database.execute("SELECT name, value FROM facts ORDER BY name"))

    def begin(
        self, person: str, sample: Callable[[Sequence[Candidate]], Sequence[int]], limit: int
    ) -> int:
        """Store the clips of a new participant, selected by ``sample``; return how many.

        Returns 0 if there are ``limit`` participants already, so that nobody can fill the disk.
        """
        with self._lock, self._transaction():
            (n_people,) = self._database.execute(
                "SELECT COUNT(*) FROM shown WHERE place = 0"
            ).fetchone()
            if n_people >= limit:
                return 0
            selected = sample(self._candidates())
            places = [(person, place, item) for place, item in enumerate(selected)]
            self._database.executemany("INSERT INTO shown VALUES (?, ?, ?)", places)
        return len(selected)

    def candidates(self) -> list[Candidate]:
        """Return the clips, and how often each has been shown."""
        with self._lock:
            return self._candidates()

    def progress(self, person: str) -> tuple[int, list[int]]:
        """Return the number of clips of a participant, and the answered places."""
        with self._lock:
            (count,) = self._database.execute(
                "SELECT COUNT(*) FROM shown WHERE person = ?", (person,)
            ).fetchone()
            rows = self._database.execute(
                "SELECT place FROM answers WHERE person = ? ORDER BY place", (person,)
            ).fetchall()
        return count, [place for (place,) in rows]

    def scene(self, person: str, place: int) -> str | None:
        """Return the clip at a place of a participant; None if there is none."""
        with self._lock:
            row = self._database.execute(
                "SELECT scene FROM shown JOIN items USING (item) WHERE person = ? AND place = ?",
                (person, place),
            ).fetchone()
        return row[0] if row else None

    def answer(self, person: str, place: int, *, real: bool) -> bool:
        """Save an answer unless the place has one; return whether the place exists."""
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
        """Return all answers."""
        with self._lock:
            rows = self._database.execute(
                "SELECT person, place, item, kind, real FROM answers "
                "JOIN shown USING (person, place) JOIN items USING (item) ORDER BY person, place"
            ).fetchall()
        return [
            Answer(person, place, item, kind, bool(real))
            for person, place, item, kind, real in rows
        ]

    def _candidates(self) -> list[Candidate]:
        rows = self._database.execute(
            "SELECT item, kind, source, (SELECT COUNT(*) FROM shown WHERE shown.item = items.item) "
            "FROM items ORDER BY item"
        )
        return [Candidate(*row) for row in rows]

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            if self._database.in_transaction:  # a full disk has ended it already
                self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")
