"""Take new captures from the inbox: good ones to the experiment's captures, others aside.

    python -m flows.inbox

A capture lies in the inbox as it would in the folder of captures. It is taken once it has stopped
changing, read as ``ingest`` would read it, and goes to the captures if it is usable; else to the
quarantine, with the reason beside it. Files that are no capture of the format stay.
"""

import time
from dataclasses import dataclass
from pathlib import Path

from dvc.repo import Repo

from apps.failure import CommandError
from apps.intake import Move, carry_out, finish
from apps.lock import one_writer
from apps.log import start_log, tell
from apps.places import ASIDE, HISTORY, INBOX, LOCK, LOG, PLAN, RUNS
from apps.records import now, recorded
from flows.dvc_locks import past_a_cut_lock
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.registry import open_format
from pacmo_core.ingestion import read_sequences
from pacmo_core.store.motions import read_skeleton
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, read_rows
from stages.common.files import CLIPS, MOTIONS
from stages.common.params import read_params
from stages.ingest import Params, ingestion_settings, is_included

SEQUENCES = Path("data/sequences")
SETTLE_S = 5.0  # a file that is still being copied changes within this


@dataclass(frozen=True)
class Intake:
    """What came of looking into the inbox."""

    taken: tuple[str, ...]
    aside: dict[str, str]  # the reason by name
    waiting: tuple[str, ...]  # still changing, or no capture of the format


def take_in(settle_s: float = SETTLE_S) -> Intake:
    """Empty the inbox of what can be judged; the caller holds the writers' lock.

    Raises
    ------
    CommandError
        If the experiment's captures are what a stage makes: nobody can add to them.
    """
    params = read_params("ingest", Params)
    raw = Path(params.raw)
    if _is_made(raw):
        raise CommandError(
            f"{raw} is what a stage makes, so {INBOX} cannot add to it; use an experiment that "
            "reads captures (docs/running.md)"
        )
    for move in finish(INBOX, PLAN):
        tell("moved what a killed run had planned", capture=move.name, to=move.to)
    if not INBOX.exists():
        return Intake((), {}, ())
    settled = _settled(settle_s)
    found = open_format(params.format, params.settings).find(INBOX)
    ready = sorted(
        (s for s in found if all(file in settled for file in s.files)), key=lambda s: s.name
    )
    moves = _judge(ready, params, raw) if ready else []
    carry_out(INBOX, moves, PLAN)
    for move in moves:
        verdict = "put aside" if move.reason else "taken in"
        tell(f"{verdict}: {move.name}", reason=move.reason, line=move.line)
    return Intake(
        tuple(move.name for move in moves if not move.reason),
        {move.name: move.reason for move in moves if move.reason},
        tuple(path.relative_to(INBOX).as_posix() for path in _files()),
    )


def _judge(ready: list[RawSequence], params: Params, raw: Path) -> list[Move]:
    recipe = ingestion_settings(params, INBOX)
    known = _known_contents()
    stamp = now().replace(":", "")
    moves = []
    for sequence, outcome in zip(ready, read_sequences(recipe, ready), strict=True):
        if isinstance(outcome, QuarantineRecord):
            reason, line = outcome.reason, outcome.line
        else:
            facts, interaction = outcome
            reason = _other_body(interaction.skeleton)
            reason = reason or _clash(sequence, facts.sha256, known, params)
            line = 0
        files = tuple(file.relative_to(INBOX).as_posix() for file in sequence.files)
        to = ASIDE / f"{sequence.name.replace('/', '_')}.{stamp}" if reason else raw
        moves.append(Move(sequence.name, files, to.as_posix(), reason, line))
    return moves


def _clash(sequence: RawSequence, digest: str, known: dict[str, str], params: Params) -> str:
    if not is_included(sequence, INBOX, params.include):
        return f"none of the patterns {', '.join(params.include)} includes it"
    taken = [Path(params.raw) / file.relative_to(INBOX) for file in sequence.files]
    for file, place in zip(sequence.files, taken, strict=True):
        if place.exists() and place.read_bytes() != file.read_bytes():
            return f"{place} is there already, with other content"
    if digest in known and known[digest] != sequence.name:
        return f"the same content as {known[digest]}"
    return ""


def _other_body(skeleton: Skeleton) -> str:
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
    first = {path: _signature(path) for path in _files()}
    if first:
        time.sleep(settle_s)
    return {path for path, was in first.items() if path.exists() and _signature(path) == was}


def _signature(path: Path) -> tuple[int, int]:
    facts = path.stat()
    return facts.st_size, facts.st_mtime_ns


def _files() -> list[Path]:
    return sorted(path for path in INBOX.rglob("*") if path.is_file())


def _is_made(raw: Path) -> bool:
    return raw.as_posix() in past_a_cut_lock(_made)


def _made() -> set[str]:
    with Repo() as repo:
        return {out.def_path for out in repo.index.outs}


def main() -> None:
    """Do it once, by hand."""
    start_log(LOG)
    HISTORY.mkdir(exist_ok=True)
    with one_writer("intake", LOCK), recorded("intake", RUNS) as run:
        intake = take_in()
        run.facts = vars(intake)


if __name__ == "__main__":
    main()
