"""Take new captures from the inbox: usable ones to the experiment's captures, others to quarantine.

    python -m flows.inbox

A capture lies in the inbox under the path that it gets in the folder of captures. It is taken once
it no longer changes, and read as the stage ``ingest`` would read it. A usable one is moved
to the captures, any other to the quarantine, with the reason beside it. Files that are not captures
of the experiment's format stay. What is no regular file (a pipe, a link to nothing or out of the
inbox) is never opened: only its reason goes to the quarantine.

All moves are first written to a plan. Every file is copied, and only then are they removed from the
inbox. The plan of a killed run is carried out again from its start: each step may be repeated.
"""

import filecmp
import json
import logging
import os
import shutil
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import chain, count
from pathlib import Path

from pacmo_core.data.limits import MAX_FOLDER_BYTES, printable, walk_files
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.registry import open_format
from pacmo_core.ingestion import read_sequences
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.processes import end_on_signal
from pacmo_core.project.records import record_run, utc_now
from pacmo_core.project.stages import readable_dvc_lock, stage_outputs
from pacmo_core.project.workspace import (
    INBOX,
    INTAKE_PLAN,
    LOCK,
    QUARANTINE,
    REASON_FILE,
    RUNS,
    CommandError,
    configure_logging,
    errors_in_one_line,
    log_event,
    one_line,
)
from pacmo_core.store.files import atomic_file, write_text
from pacmo_core.store.motions import read_skeleton
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, read_rows
from stages.common.files import CLIPS, MOTIONS
from stages.common.params import read_params
from stages.ingest import Params, ingestion_settings, is_included


@dataclass(frozen=True)
class Move:
    """The move of one capture of the inbox.

    Parameters
    ----------
    name : of the sequence
    files : its paths relative to the inbox
    to : target folder, in which the relative paths are the same
    reason : of the quarantine; empty if the capture is accepted
    line : of the file, where the error is; 0 if it has none
    """

    name: str
    files: tuple[str, ...]
    to: str
    reason: str = ""
    line: int = 0


def move_captures(inbox: Path, moves: Sequence[Move], plan: Path) -> None:
    """Write the plan and carry it out.

    Raises
    ------
    FileExistsError
        If a file of other content exists at a target: nothing is overwritten.
    """
    write_text(plan, json.dumps([asdict(move) for move in moves], indent=1) + "\n")
    finish_moves(inbox, plan)


def finish_moves(inbox: Path, plan: Path) -> list[Move]:
    """Carry out the plan, if there is one, from its start; return its moves.

    Raises
    ------
    FileExistsError
        If a file of other content exists at a target.
    ValueError, TypeError, KeyError
        If it is no plan.
    """
    if not plan.exists():
        return []
    facts = json.loads(plan.read_text(encoding="utf-8"))
    moves = [Move(**{**move, "files": tuple(move["files"])}) for move in facts]
    for move in moves:
        for file, target in zip(move.files, _targets(move), strict=True):
            _copy(inbox / file, target, is_checked=not move.reason)
        if move.reason:
            facts = {key: asdict(move)[key] for key in ("name", "line", "reason", "files")}
            write_text(Path(move.to) / REASON_FILE, json.dumps(facts) + "\n")
    for file in {file for move in moves for file in move.files}:
        (inbox / file).unlink(missing_ok=True)
        _remove_empty((inbox / file).parent, inbox)
    plan.unlink()
    return moves


def _targets(move: Move) -> list[Path]:
    """Return where the files go: under their paths, in quarantine under a number if too long."""
    names = [
        f"file-{number}" if move.reason and len(os.fsencode(file)) > MAX_QUARANTINED_PATH else file
        for number, file in enumerate(move.files)
    ]
    return [Path(move.to) / name for name in names]


def _copy(source: Path, target: Path, *, is_checked: bool) -> None:
    if not source.exists() and target.exists():
        return  # moved by an earlier run that was killed while it removed files
    if not is_checked and (source.is_symlink() or not source.is_file()):
        return
    if target.exists():
        if not filecmp.cmp(source, target, shallow=False):  # a pipe is not opened
            raise FileExistsError(f"{target} exists, with other content than {source}")
        return
    with atomic_file(target) as partial:
        shutil.copyfile(source, partial)


def _remove_empty(folder: Path, root: Path) -> None:
    while folder != root and folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
        folder = folder.parent


SEQUENCES = Path("data/sequences")
MAX_FOLDER = 150  # characters of a capture's name in that of its folder in quarantine
MAX_QUARANTINED_PATH = 1000  # bytes
SETTLE_S = 5.0  # a file that is still being copied changes within this


@dataclass(frozen=True)
class IntakeResult:
    """Result of taking captures in.

    Parameters
    ----------
    accepted : names of the captures that moved to the experiment's
    quarantined : reason by name
    waiting : files that still change, or are no capture of the format
    """

    accepted: tuple[str, ...]
    quarantined: dict[str, str]
    waiting: tuple[str, ...]


def take_captures(settle_s: float = SETTLE_S) -> IntakeResult:
    """Move complete captures out of the inbox; the caller holds the writer lock.

    Parameters
    ----------
    settle_s : seconds for which a file must not change

    Raises
    ------
    CommandError
        If the experiment's captures are the output of a stage, so that none can be added.
    """
    params = read_params("ingest", Params)
    raw = Path(params.raw)
    if _is_stage_output(raw):
        raise CommandError(
            f"{raw} is the output of a stage, so no captures of {INBOX} can be added; use an "
            "experiment that reads captures (docs/running.md)"
        )
    _finish_earlier_moves()
    if not INBOX.exists():
        return IntakeResult((), {}, ())
    settled = _settled(settle_s)
    sequences = open_format(params.format, params.settings).find(INBOX)
    ready = sorted(
        (s for s in sequences if all(file in settled for file in s.files)), key=lambda s: s.name
    )
    moves = _check_captures(ready, params, raw) if ready else []
    move_captures(INBOX, moves, INTAKE_PLAN)
    for move in moves:
        verdict = "quarantined" if move.reason else "accepted"
        log_event(f"{verdict}: {move.name}", reason=move.reason, line=move.line)
    return IntakeResult(
        tuple(move.name for move in moves if not move.reason),
        {move.name: move.reason for move in moves if move.reason},
        tuple(printable(path.relative_to(INBOX).as_posix()) for path in _left_in_inbox()),
    )


def _finish_earlier_moves() -> None:
    """Carry out the plan of a killed run; set it aside where it cannot be.

    Every file is still in the inbox then, or at its target: all are checked again.
    """
    try:
        moves = finish_moves(INBOX, INTAKE_PLAN)
    except (FileExistsError, FileNotFoundError, ValueError, TypeError, KeyError) as error:
        log_event(f"set aside {INTAKE_PLAN}: {one_line(error)}", logging.WARNING)
        INTAKE_PLAN.replace(INTAKE_PLAN.with_suffix(".broken"))
        return
    for move in moves:
        log_event(f"moved {move.name}, as a killed run had planned", to=move.to)


def _check_captures(ready: list[RawSequence], params: Params, raw: Path) -> list[Move]:
    settings = ingestion_settings(params, INBOX)
    known = _known_contents()
    existing = {s.name: s.files[0] for s in open_format(params.format, params.settings).find(raw)}
    moves: list[Move] = []
    for sequence, outcome in zip(ready, read_sequences(settings, ready), strict=True):
        if isinstance(outcome, QuarantineRecord):
            reason, line = outcome.reason, outcome.line
        else:
            facts, interaction = outcome
            reason = _skeleton_mismatch(interaction.skeleton)
            reason = reason or _name_conflict(sequence, existing, raw)
            reason = reason or _conflict(sequence, facts.sha256, known, params)
            line = 0
        files = tuple(file.relative_to(INBOX).as_posix() for file in sequence.files)
        to = _quarantine_folder(sequence.name, {move.to for move in moves}) if reason else raw
        moves.append(Move(sequence.name, files, to.as_posix(), printable(reason), line))
    return moves


def _quarantine_folder(name: str, planned: set[str]) -> Path:
    """Return a folder that neither exists nor is planned: each capture has its own reason."""
    short = name.replace("/", "_")[:MAX_FOLDER]
    folder = QUARANTINE / f"{short}.{utc_now().replace(':', '')}"
    numbered = (folder.with_name(f"{folder.name}.{number}") for number in count(2))
    return next(f for f in chain([folder], numbered) if not (f.exists() or f.as_posix() in planned))


def _name_conflict(sequence: RawSequence, existing: dict[str, Path], raw: Path) -> str:
    """Return why the captures have no place for a new one of this name and these paths."""
    files = [file.relative_to(INBOX) for file in sequence.files]
    other = existing.get(sequence.name)
    if other is not None and other.relative_to(raw) != files[0]:
        return f"the name {sequence.name} is that of {other}"
    for file in files:
        if (raw / file).is_dir():
            return f"{raw / file} is a folder"
        for folder in list((raw / file).parents)[: len(file.parts) - 1]:
            if os.path.lexists(folder) and not folder.is_dir():
                return f"{folder} is a file, where a folder is wanted"
    return ""


def _conflict(sequence: RawSequence, digest: str, known: dict[str, str], params: Params) -> str:
    if not is_included(sequence, INBOX, params.include):
        return f"none of the patterns {', '.join(params.include)} includes it"
    targets = [Path(params.raw) / file.relative_to(INBOX) for file in sequence.files]
    for file, target in zip(sequence.files, targets, strict=True):
        if target.exists() and not filecmp.cmp(file, target, shallow=False):
            return f"{target} exists, with other content"
    if digest in known and known[digest] != sequence.name:
        return f"the same content as {known[digest]}"
    return ""


def _skeleton_mismatch(skeleton: Skeleton) -> str:
    # A dataset has the skeleton of its first capture, in the order of names; a new capture that
    # comes first must not change it.
    motions = SEQUENCES / MOTIONS
    known = read_skeleton(motions) if motions.exists() else skeleton
    if skeleton == known:
        return ""
    return (
        f"{len(skeleton.joints)} joints ({skeleton.name}) where the captures have "
        f"{len(known.joints)} ({known.name})"
    )


def _known_contents() -> dict[str, str]:
    """Return the names of existing captures by the hash of their content."""
    table = SEQUENCES / CLIPS
    if not table.exists():
        return {}
    return {row.sha256: row.sequence for row in read_rows(table, ClipRecord)}


def _settled(settle_s: float) -> set[Path]:
    """List the files that do not change for a while, whatever the clock says."""
    first = {path: _signature(path) for path in _inbox_files()}
    if first:
        time.sleep(settle_s)
    settled = {p for p, old in first.items() if os.path.lexists(p) and _signature(p) == old}
    # A file that may not be read could not be copied either: it stays.
    return {p for p in settled if not p.is_file() or os.access(p, os.R_OK)}


def _signature(path: Path) -> tuple[int, int]:
    facts = path.lstat()
    return facts.st_size, facts.st_mtime_ns


def _inbox_files() -> list[Path]:
    return sorted(walk_files(INBOX))


def _left_in_inbox() -> list[Path]:
    """List the files of the inbox, and the folders that are too deep to be searched."""
    deep: list[Path] = []
    files = sorted(walk_files(INBOX, deep))
    for folder in deep:
        path = printable(f"{folder.as_posix()[:MAX_FOLDER]}...")
        log_event(f"left in the inbox: {path}, a path of more than {MAX_FOLDER_BYTES} bytes")
    return files + deep


def _is_stage_output(raw: Path) -> bool:
    return raw.as_posix() in readable_dvc_lock(stage_outputs)


def main() -> None:
    """Take captures in."""
    with (
        end_on_signal(lambda: "interrupted; the next run continues"),
        errors_in_one_line(),
        writer_lock("intake", LOCK),
        record_run("intake", RUNS) as run,
    ):
        configure_logging()
        run.facts = vars(take_captures())


if __name__ == "__main__":
    main()
