"""Move captures out of the inbox, so that a kill at any moment loses none and halves none.

What is to be done is first written down whole, as a plan. Then every file is copied to its place,
and only when all are there are they removed from the inbox. A plan that a killed run left is
carried out again from its begin: each step may be done twice.
"""

import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from dvc.repo import Repo

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.registry import open_format
from pacmo_core.ingestion import read_sequences
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.records import record_run, utc_now
from pacmo_core.project.stages import readable_dvc_lock
from pacmo_core.project.workspace import (
    HISTORY,
    INBOX,
    INTAKE_PLAN,
    LOCK,
    LOG,
    QUARANTINE,
    REASON_FILE,
    RUNS,
    CommandError,
    configure_logging,
    log_event,
)
from pacmo_core.store.files import atomic_file, write_text
from pacmo_core.store.motions import read_skeleton
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, read_rows
from stages.common.files import CLIPS, MOTIONS
from stages.common.params import read_params
from stages.ingest import Params, ingestion_settings, is_included


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


def move_captures(inbox: Path, moves: Sequence[Move], plan: Path) -> None:
    """Move captures as planned.

    Raises
    ------
    FileExistsError
        If a place is taken by a file of other content: nothing is ever overwritten.
    """
    write_text(plan, json.dumps([asdict(move) for move in moves], indent=1) + "\n")
    finish_moves(inbox, plan)


def finish_moves(inbox: Path, plan: Path) -> list[Move]:
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
            write_text(Path(move.to) / REASON_FILE, text + "\n")
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


# FROM """Take new captures from the inbox: good ones to the experiment's captures, others aside.
# FROM
# FROM     python -m flows.inbox
# FROM
# FROM A capture lies in the inbox as it would in the folder of captures. It is taken once it has stopped
# FROM changing, read as ``ingest`` would read it, and goes to the captures if it is usable; else to the
# FROM quarantine, with the reason beside it. Files that are no capture of the format stay.
# FROM """
SEQUENCES = Path("data/sequences")
SETTLE_S = 5.0  # a file that is still being copied changes within this


@dataclass(frozen=True)
class IntakeResult:
    """What came of looking into the inbox."""

    taken: tuple[str, ...]
    aside: dict[str, str]  # the reason by name
    waiting: tuple[str, ...]  # still changing, or no capture of the format


def take_captures(settle_s: float = SETTLE_S) -> IntakeResult:
    """Empty the inbox of what can be judged; the caller holds the writers' lock.

    Raises
    ------
    CommandError
        If the experiment's captures are what a stage makes: nobody can add to them.
    """
    params = read_params("ingest", Params)
    raw = Path(params.raw)
    if _is_stage_output(raw):
        raise CommandError(
            f"{raw} is what a stage makes, so {INBOX} cannot add to it; use an experiment that "
            "reads captures (docs/running.md)"
        )
    for move in finish_moves(INBOX, INTAKE_PLAN):
        log_event("moved what a killed run had planned", capture=move.name, to=move.to)
    if not INBOX.exists():
        return IntakeResult((), {}, ())
    settled = _settled(settle_s)
    found = open_format(params.format, params.settings).find(INBOX)
    ready = sorted(
        (s for s in found if all(file in settled for file in s.files)), key=lambda s: s.name
    )
    moves = _check_captures(ready, params, raw) if ready else []
    move_captures(INBOX, moves, INTAKE_PLAN)
    for move in moves:
        verdict = "put aside" if move.reason else "taken in"
        log_event(f"{verdict}: {move.name}", reason=move.reason, line=move.line)
    return IntakeResult(
        tuple(move.name for move in moves if not move.reason),
        {move.name: move.reason for move in moves if move.reason},
        tuple(path.relative_to(INBOX).as_posix() for path in _inbox_files()),
    )


def _check_captures(ready: list[RawSequence], params: Params, raw: Path) -> list[Move]:
    recipe = ingestion_settings(params, INBOX)
    known = _known_contents()
    stamp = utc_now().replace(":", "")
    moves = []
    for sequence, outcome in zip(ready, read_sequences(recipe, ready), strict=True):
        if isinstance(outcome, QuarantineRecord):
            reason, line = outcome.reason, outcome.line
        else:
            facts, interaction = outcome
            reason = _skeleton_mismatch(interaction.skeleton)
            reason = reason or _conflict(sequence, facts.sha256, known, params)
            line = 0
        files = tuple(file.relative_to(INBOX).as_posix() for file in sequence.files)
        to = QUARANTINE / f"{sequence.name.replace('/', '_')}.{stamp}" if reason else raw
        moves.append(Move(sequence.name, files, to.as_posix(), reason, line))
    return moves


def _conflict(sequence: RawSequence, digest: str, known: dict[str, str], params: Params) -> str:
    if not is_included(sequence, INBOX, params.include):
        return f"none of the patterns {', '.join(params.include)} includes it"
    taken = [Path(params.raw) / file.relative_to(INBOX) for file in sequence.files]
    for file, place in zip(sequence.files, taken, strict=True):
        if place.exists() and place.read_bytes() != file.read_bytes():
            return f"{place} is there already, with other content"
    if digest in known and known[digest] != sequence.name:
        return f"the same content as {known[digest]}"
    return ""


def _skeleton_mismatch(skeleton: Skeleton) -> str:
    # A set has one skeleton, its first capture's: one that comes to stand first must not change it.
    motions = SEQUENCES / MOTIONS
    known = read_skeleton(motions) if motions.exists() else skeleton
    if skeleton == known:
        return ""
    return (
        f"{len(skeleton.joints)} joints ({skeleton.name}) where the captures have "
        f"{len(known.joints)} ({known.name})"
    )


def _known_contents() -> dict[str, str]:
    """Name the captures that are in by their content."""
    table = SEQUENCES / CLIPS
    if not table.exists():
        return {}
    return {row.sha256: row.sequence for row in read_rows(table, ClipRecord)}


def _settled(settle_s: float) -> set[Path]:
    """List the files that do not change for a while; no clock is asked, as clocks jump."""
    first = {path: _signature(path) for path in _inbox_files()}
    if first:
        time.sleep(settle_s)
    return {path for path, was in first.items() if path.exists() and _signature(path) == was}


def _signature(path: Path) -> tuple[int, int]:
    facts = path.stat()
    return facts.st_size, facts.st_mtime_ns


def _inbox_files() -> list[Path]:
    return sorted(path for path in INBOX.rglob("*") if path.is_file())


def _is_stage_output(raw: Path) -> bool:
    return raw.as_posix() in readable_dvc_lock(_stage_outputs)


def _stage_outputs() -> set[str]:
    with Repo() as repo:
        return {out.def_path for out in repo.index.outs}


def main() -> None:
    """Do it once, by hand."""
    configure_logging(LOG)
    HISTORY.mkdir(exist_ok=True)
    with writer_lock("intake", LOCK), record_run("intake", RUNS) as run:
        intake = take_captures()
        run.facts = vars(intake)


if __name__ == "__main__":
    main()
