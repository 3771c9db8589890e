"""``pacmo status`` and ``pacmo rollback``: what an operator sees, and one thing that he may do."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from textwrap import shorten
from typing import Annotated, Any

import typer

from apps.failure import FAILED, told_in_one_line
from apps.intake import REASON
from apps.lock import is_held, one_writer
from apps.places import ASIDE, DECISIONS, DVC_CACHE, INBOX, LOCK, PLAN, RUNS, SHELF
from apps.promote import roll_back
from apps.records import DONE, HELD, SKIPPED, Run, read_runs, recorded
from pacmo_core import promotion
from pacmo_core.promotion import Decision, read_decisions

_GOOD = (DONE, HELD, SKIPPED)
_SHOWN = 5  # of each list
_MOST_WORDS = 90  # characters of a reason why a stage is stale; --json has all of it

AsJson = Annotated[bool, typer.Option("--json", help="print one JSON object")]
Check = Annotated[bool, typer.Option("--check", help="exit code 1 if the last run failed")]
Stale = Annotated[bool, typer.Option(help="ask DVC what is stale (about a second)")]
Why = Annotated[str, typer.Option("--why", help="goes into the history")]


def show_status(as_json: AsJson = False, check: Check = False, stale: Stale = True) -> None:
    """Show the last runs, what is current, stale, waiting and put aside, and the disk."""
    with told_in_one_line():
        facts = status(stale=stale)
        typer.echo(json.dumps(facts, indent=2) if as_json else "\n".join(lines_of(facts)))
        last = facts["runs"][-1]["outcome"] if facts["runs"] else DONE
        if check and last not in _GOOD and not facts["writing"]:
            raise typer.Exit(FAILED)


def roll_back_model(why: Why) -> None:
    """Bring back the model that was current before, weights included.

    The one taken back stays among the promoted models and is not promoted again.
    """
    with (
        told_in_one_line(),
        one_writer("rollback", LOCK),
        recorded("rollback", RUNS) as run,
    ):
        decision = roll_back(why)
        run.reason = decision.reasons[0]
        typer.echo(
            f"current is {SHELF / f'{decision.current_model:06d}'}, model {decision.model[:12]}"
        )


def status(*, stale: bool) -> dict[str, Any]:
    """Gather what an operator asks for, in JSON's terms."""
    decisions, broken = read_decisions(DECISIONS)
    usage, writing = shutil.disk_usage(Path.cwd()), is_held(LOCK)
    return {
        "writing": writing,
        "runs": [asdict(run) for run in told(read_runs(RUNS)[-_SHOWN:], writing)],
        "current": promotion.current_model(SHELF),
        "decisions": [asdict(decision) for decision in decisions[-_SHOWN:]],
        "broken_decisions": [fault.file.as_posix() for fault in broken],
        "stale": stale_reasons(writing) if stale else {},
        "inbox": [file.relative_to(INBOX).as_posix() for file in _files(INBOX)],
        "unfinished_intake": PLAN.exists(),
        "quarantine": quarantine(),
        "free_gb": round(usage.free / 1e9, 1),
        "cache_gb": round(sum(file.stat().st_size for file in _files(DVC_CACHE)) / 1e9, 2),
    }


def told(runs: list[Run], writing: str) -> list[Run]:
    """Call a run killed that says it runs while nobody holds the lock."""
    for run in runs:
        if run.outcome == "running" and not writing:
            run.outcome, run.reason = "killed", "the process ended before the run did"
    return runs


def stale_reasons(writing: str) -> dict[str, list[str]]:
    """Ask DVC what is stale and why, by stage; it cannot tell while a stage runs."""
    if writing:
        return {"unknown": ["a run writes now, and DVC tells only after it"]}
    command = [sys.executable, "-m", "dvc", "status", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"unknown": [done.stderr.strip()]}
    return {name: list(_changes(found)) for name, found in json.loads(done.stdout).items()}


def quarantine() -> list[dict[str, Any]]:
    """List what was put aside from the inbox, with the reason."""
    found = []
    for file in sorted(ASIDE.glob(f"*/{REASON}")):
        facts = json.loads(file.read_text(encoding="utf-8"))
        found.append({"folder": file.parent.as_posix(), **facts})
    return found


def lines_of(facts: dict[str, Any]) -> Iterable[str]:
    """Write it for a person."""
    yield f"writing now   {_writer(facts['writing'])}"
    yield f"current       {facts['current'] or 'none'}"
    yield f"disk          {facts['free_gb']} GB free; DVC's cache {facts['cache_gb']} GB"
    yield from _block("runs", [_run_line(Run(**run)) for run in facts["runs"]])
    yield from _block("decisions", [_decision_line(Decision(**d)) for d in facts["decisions"]])
    yield from _block("stale", [_stale_line(*item) for item in facts["stale"].items()])
    yield from _block("inbox", facts["inbox"])
    aside = [f"{q['name']}: {q['reason']}" for q in facts["quarantine"]]
    yield from _block("quarantine", aside)
    if facts["unfinished_intake"]:
        yield "an intake was cut short; the next night finishes it"
    for file in facts["broken_decisions"]:
        yield f"unreadable: {file}"


def _writer(held: str) -> str:
    if not held.startswith("{"):
        return held or "nobody"
    facts = json.loads(held)
    return f"{facts['job']} since {facts['since']}, process {facts['pid']}"


def _block(name: str, lines: list[str]) -> Iterable[str]:
    yield f"{name:13} {len(lines) or 'none'}"
    yield from (f"  {line}" for line in lines[:20])


def _stale_line(stage: str, reasons: list[str]) -> str:
    return f"{stage}: {'; '.join(shorten(reason, _MOST_WORDS) for reason in reasons)}"


def _run_line(run: Run) -> str:
    return f"{run.number} {run.started} {run.job}: {run.outcome}  {run.reason}".rstrip()


def _decision_line(decision: Decision) -> str:
    return f"{decision.number} {decision.at} {decision.verdict}  {'; '.join(decision.reasons)}"


def _changes(found: list[Any]) -> Iterable[str]:
    """Flatten what ``dvc status`` says of a stage: ``changed deps: data/raw modified``."""
    for entry in found:
        if isinstance(entry, str):
            yield entry
            continue
        for kind, things in entry.items():
            named = things.items() if isinstance(things, dict) else [(things, "")]
            yield f"{kind}: " + ", ".join(f"{name} {how}".strip() for name, how in named)


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())
