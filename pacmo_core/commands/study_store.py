"""What stands in a study's file: its tables, their rows, and a new one."""

import json
import sqlite3
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName
from pacmo_core.figures.viewer import Scene, packed_scenes
from pacmo_core.project.workspace import MOTIONS, CommandError
from pacmo_core.store.files import StoreError
from pacmo_core.store.motions import read_motion, stream_motions

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
    with _open_file(path) as database:
        database.executescript(_TABLES)
        rows = [(item.kind, item.source, item.scene) for item in items]
        database.executemany("INSERT INTO items (kind, source, scene) VALUES (?, ?, ?)", rows)
        database.executemany("INSERT INTO facts VALUES (?, ?)", facts.items())
        database.execute(f"PRAGMA user_version = {VERSION}")


@contextmanager
def _open_file(path: Path) -> Iterator[sqlite3.Connection]:
    database = sqlite3.connect(path)
    try:
        with database:
            yield database
    finally:
        database.close()


__all__ = [
    "GENERATED",
    "REAL",
    "Answer",
    "Candidate",
    "Item",
    "Study",
    "write_study",
]

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
            selected = draw(self._candidates())
            places = [(person, path, item) for path, item in enumerate(selected)]
            self._database.executemany("INSERT INTO shown VALUES (?, ?, ?)", places)
        return len(selected)

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
        return count, [path for (path,) in rows]

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
            Answer(person, path, item, kind, bool(real)) for person, path, item, kind, real in rows
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


def sample_items(
    clips: Path, reactions: Path, count: int, random: np.random.Generator
) -> Iterator[Item]:
    """Draw captured clips that a model answered, and beside each its first answer.

    Raises
    ------
    CommandError
        If the model answered too few.
    """
    named = ((ReactionName.parse(n), motion) for n, motion in stream_motions(reactions / MOTIONS))
    answered = {name: motion for name, motion in named if name.sample == 0}
    sources = sorted({name.clip for name in answered})
    if len(sources) < count:
        raise CommandError(f"{reactions}: wanted answers to {count} clips; got {len(sources)}")
    for source in random.choice(np.array(sources), count, replace=False).tolist():
        names = [name for name in answered if name.clip == source]
        name = names[int(random.integers(len(names)))]
        reaction = answered[name].swapped() if name.direction == "a" else answered[name]
        yield _item(REAL, source, read_motion(clips / MOTIONS, source))
        yield _item(GENERATED, source, reaction)


def _item(kind: str, source: str, shown: Interaction) -> Item:
    """Pack a clip without a word of what it is."""
    return Item(kind, source, json.dumps(packed_scenes([Scene.of("", shown)], contact=0.0)))


def balanced_sample(
    candidates: Sequence[Candidate], count: int, random: np.random.Generator
) -> list[int]:
    """Choose half of each kind, those least shown first, each source once, in random order.

    Parameters
    ----------
    count : how many; of an odd one, chance says which kind has one more

    Raises
    ------
    ValueError
        If there are too few sources.
    """
    order = random.permutation(len(candidates))
    waiting = sorted((candidates[k] for k in order), key=lambda c: c.times_shown)
    expected = {REAL: count // 2, GENERATED: count // 2}
    expected[(REAL, GENERATED)[int(random.integers(2))]] += count % 2
    selected: list[int] = []
    sources: set[str] = set()
    for kind in random.permutation(np.array([REAL, GENERATED])).tolist():
        fitting = [c for c in waiting if c.kind == kind and c.source not in sources]
        if len(fitting) < expected[kind]:
            raise ValueError(f"a participant wants {count} sources; the study has fewer")
        selected += [c.item for c in fitting[: expected[kind]]]
        sources |= {c.source for c in fitting[: expected[kind]]}
    return [selected[k] for k in random.permutation(len(selected))]
