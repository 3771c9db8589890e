"""What stands in a study's file: its tables, their rows, and a new one."""

import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

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


def write_study(path: Path, items: Iterable[Item], facts: Mapping[str, str]) -> None:
    """Write a study that nobody has answered.

    Parameters
    ----------
    facts : what it was made of; never shown to who takes part

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
        database.executemany("INSERT INTO facts VALUES (?, ?)", facts.items())
        database.execute(f"PRAGMA user_version = {VERSION}")


@contextmanager
def _open(path: Path) -> Iterator[sqlite3.Connection]:
    database = sqlite3.connect(path)
    try:
        with database:
            yield database
    finally:
        database.close()
