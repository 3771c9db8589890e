"""A perceptual study in one SQLite file: what is shown, to whom, and what they said.

Nothing personal is kept: a participant is a random word. An answer is acknowledged once it is on
the disk, and the first to a place stands, however often it is sent.
"""

import sqlite3
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pacmo_core.store.files import StoreError
from pacmo_core.store.study_file import (
    GENERATED,
    REAL,
    VERSION,
    Answer,
    Candidate,
    Item,
    write_study,
)

__all__ = [
    "GENERATED",
    "REAL",
    "Answer",
    "Candidate",
    "Item",
    "Study",
    "write_study",
]

_PATIENCE_S = 30.0


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
        if version != VERSION:
            raise StoreError(f"{path}: wanted a study of version {VERSION}, got {version}")
        for setting in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
            self._database.execute(f"PRAGMA {setting}")

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def facts(self) -> dict[str, str]:
        """Say what the study was made of."""
        with self._lock:
            return dict(self._database.execute("SELECT name, value FROM facts ORDER BY name"))

    def begin(
        self, person: str, draw: Callable[[Sequence[Candidate]], Sequence[int]], most: int
    ) -> int:
        """Lay out the clips for a new participant, as ``draw`` chooses; say how many.

        None, if ``most`` people have begun already: nobody can fill the disk.
        """
        with self._lock, self._all_or_nothing():
            (begun,) = self._database.execute(
                "SELECT COUNT(*) FROM shown WHERE place = 0"
            ).fetchone()
            if begun >= most:
                return 0
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
    def _all_or_nothing(self) -> Iterator[None]:
        self._database.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")
