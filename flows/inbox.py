"""Take new captures from the inbox: usable ones to the experiment's captures, others to quarantine.

    python -m flows.inbox

A capture lies in the inbox under the path that it gets in the folder of captures. It is taken once
it no longer changes, and read as the stage ``ingest`` would read it. A usable one is moved
to the captures, any other to the quarantine, with the reason beside it. Files that are not captures
of the experiment's format stay. What is no regular file (a pipe, a link to nothing or out of the
inbox) is never opened: only its reason goes to the quarantine.

All moves are first written to a plan. Every file is copied, and only then are they removed from the
inbox. The plan of a killed run is carried out again from its start: each step may be repeated. A
capture of which a file is gone by then stays as it is; one whose path the system refuses is
quarantined instead.
"""

import errno
import filecmp
import hashlib
import json
import logging
import os
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import chain, count
from pathlib import Path

from pacmo_core.data.limits import MAX_FOLDER_BYTES, printable, walk_files
from pacmo_core.data.skeleton import Skeleton, skeleton_difference
from pacmo_core.formats.base import RawSequence
from pacmo_core.ingestion import Capture, file_fault, read_sequences
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
from stages.common.captures import open_captures
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
    is_numbered : the files are named ``file-0`` and so on, as the system refused their paths
    """

    name: str
    files: tuple[str, ...]
    to: str
    reason: str = ""
    line: int = 0
    is_numbered: bool = False


# Errors of one path. Others (a full disk, a folder that may not be written) are of the machine:
# they end the run, which the next one continues.
REFUSALS = frozenset(
    {errno.ENAMETOOLONG, errno.EILSEQ, errno.EINVAL, errno.ELOOP, errno.ENOTDIR, errno.EISDIR}
)


def move_captures(inbox: Path, moves: Sequence[Move], plan: Path) -> list[Move]:
    """Write the plan and carry it out; return the moves that were made.

    Raises
    ------
    FileExistsError
        If a file of other content exists at a target: nothing is overwritten.
    """
    _write_plan(plan, moves)
    return finish_moves(inbox, plan)


def _write_plan(plan: Path, moves: Sequence[Move]) -> None:
    write_text(plan, json.dumps([asdict(move) for move in moves], indent=1) + "\n")


def finish_moves(inbox: Path, plan: Path) -> list[Move]:
    """Carry out the plan, if there is one, from its start; return the moves that were made.

    A capture of which a file is gone is not moved. One whose path the system refuses goes to the
    quarantine: the plan is changed first, so that a killed run continues with the change.

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
    made = []
    for number, move in enumerate(moves):
        try:
            is_made = _copy_files(inbox, move)
        except OSError as error:
            if error.errno not in REFUSALS or move.is_numbered:
                raise
            moves[number] = _quarantined(move, error, {other.to for other in moves})
            _write_plan(plan, moves)
            is_made = _copy_files(inbox, moves[number])
        if is_made:
            made.append(moves[number])
    for file in {file for move in made for file in move.files}:
        (inbox / file).unlink(missing_ok=True)
        _remove_empty((inbox / file).parent, inbox)
    plan.unlink()
    return made


def _quarantined(move: Move, error: OSError, planned: set[str]) -> Move:
    """Return the move to the quarantine, under short names, of what the system refused."""
    to = _quarantine_folder(move.name, planned).as_posix()
    return replace(move, to=to, reason=move.reason or one_line(error), is_numbered=True)


def _copy_files(inbox: Path, move: Move) -> bool:
    """Copy a capture's files, with its reason; if one is gone, undo that and return False."""
    copied = []
    try:
        for file, target in zip(move.files, _targets(move), strict=True):
            if _copy(inbox / file, target, is_checked=not move.reason):
                copied.append((inbox / file, target))
        if move.reason:
            facts = {key: asdict(move)[key] for key in ("name", "line", "reason", "files")}
            write_text(Path(move.to) / REASON_FILE, json.dumps(facts) + "\n")
    except OSError as error:
        _undo(move, copied)
        if not isinstance(error, FileNotFoundError) or _are_there(inbox, move.files):
            raise
        log_event(f"gone from the inbox: {printable(move.name)}", logging.WARNING)
        return False
    return True


def _undo(move: Move, copied: list[tuple[Path, Path]]) -> None:
    for source, target in copied:
        if os.path.lexists(source):  # or the copy is the only one
            target.unlink()
    for target in _targets(move):
        _remove_empty(target.parent, Path(move.to))


def _are_there(inbox: Path, files: Sequence[str]) -> bool:
    return all(os.path.lexists(inbox / file) for file in files)


def _targets(move: Move) -> list[Path]:
    """Return where the files go: under their paths, in quarantine under a number if too long."""
    return [Path(move.to) / _target_name(move, *numbered) for numbered in enumerate(move.files)]


def _target_name(move: Move, number: int, file: str) -> str:
    is_long = bool(move.reason) and len(os.fsencode(file)) > MAX_QUARANTINED_PATH
    return f"file-{number}" if is_long or move.is_numbered else file


def _copy(source: Path, target: Path, *, is_checked: bool) -> bool:
    """Copy a file; return False if nothing was to be copied."""
    if not source.exists() and target.exists():
        return False  # moved by an earlier run that was killed while it removed files
    if not is_checked and (source.is_symlink() or not source.is_file()):
        return False
    if target.exists():
        if not filecmp.cmp(source, target, shallow=False):  # a pipe is not opened
            raise FileExistsError(f"{target} exists, with other content than {source}")
        return False
    with atomic_file(target) as partial:
        shutil.copyfile(source, partial)
    return True


def _remove_empty(folder: Path, root: Path) -> None:
    with suppress(OSError):  # it is not empty
        while folder != root:
            folder.rmdir()
            folder = folder.parent


SEQUENCES = Path("data/sequences")
MAX_FOLDER = 150  # bytes of a capture's name in that of its folder in quarantine
N_HASH = 8  # hexadecimal digits that stand for the rest of a longer name
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
    gone : names of the captures that were removed from the inbox meanwhile
    """

    accepted: tuple[str, ...]
    quarantined: dict[str, str]
    waiting: tuple[str, ...]
    gone: tuple[str, ...] = ()


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
    reader = open_captures("ingest", params.format, params.settings)
    sequences = reader.find(INBOX)
    ready = sorted(
        (s for s in sequences if all(file in settled for file in s.files)), key=lambda s: s.name
    )
    planned = _check_captures(ready, params, raw) if ready else []
    moves = move_captures(INBOX, planned, INTAKE_PLAN)
    for move in moves:
        verdict = "quarantined" if move.reason else "accepted"
        why = f": {move.reason}" if move.reason else ""
        log_event(f"{verdict}: {move.name}{why}", reason=move.reason, line=move.line)
    return IntakeResult(
        tuple(move.name for move in moves if not move.reason),
        {move.name: move.reason for move in moves if move.reason},
        tuple(printable(path.relative_to(INBOX).as_posix()) for path in _left_in_inbox()),
        _names_of_gone(ready, moves),
    )


def _names_of_gone(ready: list[RawSequence], moves: list[Move]) -> tuple[str, ...]:
    made = {move.files for move in moves}
    return tuple(printable(s.name) for s in ready if _files_in_inbox(s) not in made)


def _files_in_inbox(sequence: RawSequence) -> tuple[str, ...]:
    return tuple(file.relative_to(INBOX).as_posix() for file in sequence.files)


def _finish_earlier_moves() -> None:
    """Carry out the plan of a killed run; set it aside where it cannot be.

    Every file is still in the inbox then, or at its target: all are checked again.
    """
    try:
        moves = finish_moves(INBOX, INTAKE_PLAN)
    except (FileExistsError, ValueError, TypeError, KeyError) as error:
        log_event(f"set aside {INTAKE_PLAN}: {one_line(error)}", logging.WARNING)
        INTAKE_PLAN.replace(INTAKE_PLAN.with_suffix(".broken"))
        return
    for move in moves:
        log_event(f"moved {move.name}, as a killed run had planned", to=move.to)


def _check_captures(ready: list[RawSequence], params: Params, raw: Path) -> list[Move]:
    settings = ingestion_settings(params, INBOX)
    known = _known_captures(params.dataset)
    existing = {s.name: s.files[0] for s in settings.format.find(raw)}
    # Before they are read: the content of one that is refused for its place may come again under
    # another name, and is no double then.
    conflicts = [_refused_place(sequence, existing, params) for sequence in ready]
    free = [s for s, conflict in zip(ready, conflicts, strict=True) if not conflict]
    outcomes = iter(read_sequences(settings, free))
    moves: list[Move] = []
    for sequence, conflict in zip(ready, conflicts, strict=True):
        reason, line = (conflict, 0) if conflict else _verdict(sequence, next(outcomes), known)
        files = _files_in_inbox(sequence)
        if not _are_there(INBOX, files):
            log_event(f"gone from the inbox: {printable(sequence.name)}", logging.WARNING)
            continue
        to = _quarantine_folder(sequence.name, {move.to for move in moves}) if reason else raw
        moves.append(Move(sequence.name, files, to.as_posix(), printable(reason), line))
    return moves


def _refused_place(sequence: RawSequence, existing: dict[str, Path], params: Params) -> str:
    """Return why there is no place for a capture of these names; empty if it may be read."""
    resolved, raw = INBOX.resolve(), Path(params.raw)
    if any(file_fault(file, INBOX, resolved) for file in sequence.files):
        return ""  # which is said where it is read
    return _refusal(
        lambda: _name_conflict(sequence, existing, raw) or _place_conflict(sequence, params)
    )


def _verdict(
    sequence: RawSequence,
    outcome: Capture | QuarantineRecord,
    known: "_Known",
) -> tuple[str, int]:
    """Return why a capture is not taken, empty if it is, and the line of the fault."""
    if isinstance(outcome, QuarantineRecord):
        return outcome.reason, outcome.line
    facts, interaction = outcome
    skeleton = known.skeleton or interaction.skeleton
    mismatch = skeleton_difference(interaction.skeleton, skeleton, "the captures have")
    first = known.names.get(facts.sha256, sequence.name)
    return mismatch or (f"the same content as {first}" if first != sequence.name else ""), 0


def _refusal(reason: Callable[[], str]) -> str:
    """Return a reason, or that for which the system refuses to look for one."""
    try:
        return reason()
    except FileNotFoundError as error:  # removed from the inbox meanwhile
        return one_line(error)
    except OSError as error:
        if error.errno not in REFUSALS:
            raise
        return one_line(error)


def _quarantine_folder(name: str, planned: set[str]) -> Path:
    """Return a folder that neither exists nor is planned: each capture has its own reason."""
    short = shorten_name(name.replace("/", "_"), MAX_FOLDER)
    folder = QUARANTINE / f"{short}.{utc_now().replace(':', '')}"
    numbered = (folder.with_name(f"{folder.name}.{number}") for number in count(2))
    return next(f for f in chain([folder], numbered) if not (f.exists() or f.as_posix() in planned))


def shorten_name(name: str, max_bytes: int) -> str:
    """Cut a file name that is longer between two characters, and add a hash of what was cut.

    Parameters
    ----------
    name : file name without folders
    max_bytes : of the result; the systems' limit of 255 is of bytes too, not of characters
    """
    encoded = os.fsencode(name)
    if len(encoded) <= max_bytes:
        return name
    n_kept = max_bytes - 1 - N_HASH
    kept = encoded[:n_kept].decode("utf-8", errors="ignore")
    return f"{kept}-{hashlib.sha256(encoded[n_kept:]).hexdigest()[:N_HASH]}"


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


def _place_conflict(sequence: RawSequence, params: Params) -> str:
    """Return why a capture has no place among those of the experiment."""
    if not is_included(sequence, INBOX, params.include):
        return f"none of the patterns {', '.join(params.include)} includes it"
    for file in sequence.files:
        target = Path(params.raw) / file.relative_to(INBOX)
        if target.exists() and not filecmp.cmp(file, target, shallow=False):
            return f"{target} exists, with other content"
    return ""


@dataclass(frozen=True)
class _Known:
    """The captures that are ingested.

    Parameters
    ----------
    names : by the hash of their content
    skeleton : which a new capture that comes first in the order of names must not change; None
        without captures
    """

    names: dict[str, str]
    skeleton: Skeleton | None


def _known_captures(dataset: str) -> _Known:
    """Read what is known of a dataset's captures: nothing where those of another are ingested."""
    table = SEQUENCES / CLIPS
    rows = read_rows(table, ClipRecord) if table.exists() else []
    names = {row.sha256: row.sequence for row in rows if row.dataset == dataset}
    return _Known(names, read_skeleton(SEQUENCES / MOTIONS) if names else None)


def _settled(settle_s: float) -> set[Path]:
    """List the files that do not change for a while, whatever the clock says."""
    first = {path: _signature(path) for path in _inbox_files()}
    if first:
        time.sleep(settle_s)
    settled = {p for p, old in first.items() if old is not None and _signature(p) == old}
    # A file that may not be read could not be copied either: it stays.
    return {p for p in settled if not p.is_file() or os.access(p, os.R_OK)}


def _signature(path: Path) -> tuple[int, int] | None:
    """Return size and time of change; None if the file is gone."""
    try:
        facts = path.lstat()
    except FileNotFoundError:
        return None
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
