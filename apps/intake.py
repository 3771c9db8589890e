"""Move captures out of the inbox, so that a kill at any moment loses none and halves none.

What is to be done is first written down whole, as a plan. Then every file is copied to its place,
and only when all are there are they removed from the inbox. A plan that a killed run left is
carried out again from its begin: each step may be done twice.
"""

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pacmo_core.store.files import atomic_file, write_text

REASON = "reason.json"


@dataclass(frozen=True)
class Move:
    """One capture's way out of the inbox.

    Parameters
    ----------
    name : of the sequence
    files : its paths relative to the inbox
    to : the folder that they go to, under the same relative paths
    reason : why it was put aside; empty if it is taken in
    line : of the file at fault, 0 where there is none to name
    """

    name: str
    files: tuple[str, ...]
    to: str
    reason: str = ""
    line: int = 0


def carry_out(inbox: Path, moves: Sequence[Move], plan: Path) -> None:
    """Move captures as planned.

    Raises
    ------
    FileExistsError
        If a place is taken by a file of other content: nothing is ever overwritten.
    """
    write_text(plan, json.dumps([asdict(move) for move in moves], indent=1) + "\n")
    finish(inbox, plan)


def finish(inbox: Path, plan: Path) -> list[Move]:
    """Carry out a plan that stands there, from its begin; none is no work."""
    if not plan.exists():
        return []
    facts = json.loads(plan.read_text(encoding="utf-8"))
    moves = [Move(**{**move, "files": tuple(move["files"])}) for move in facts]
    for move in moves:
        for file in move.files:
            _copy(inbox / file, Path(move.to) / file)
        if move.reason:
            text = json.dumps({key: asdict(move)[key] for key in ("name", "line", "reason")})
            write_text(Path(move.to) / REASON, text + "\n")
    for file in {file for move in moves for file in move.files}:
        (inbox / file).unlink(missing_ok=True)
        _remove_empty((inbox / file).parent, inbox)
    plan.unlink()
    return moves


def _copy(source: Path, target: Path) -> None:
    if not source.exists() and target.exists():
        return  # an earlier run, killed while it removed, came so far
    if target.exists():
        if target.read_bytes() != source.read_bytes():
            raise FileExistsError(f"{target} is there already, with other content than {source}")
        return
    with atomic_file(target) as partial:
        shutil.copyfile(source, partial)


def _remove_empty(folder: Path, root: Path) -> None:
    while folder != root and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
        folder = folder.parent
