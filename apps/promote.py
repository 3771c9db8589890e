"""Make a trained model current, hold it back, or bring back the one before.

A decision is written down before the link ``promoted/current`` follows it; ``settle`` lets the
link follow where a kill came between.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from apps.failure import CommandError
from apps.history_page import write_page
from apps.places import DECISIONS, METRICS, PAGE, REPORT, SHELF
from apps.records import now
from pacmo_core import promotion
from pacmo_core.promotion import (
    PROMOTED,
    REJECTED,
    ROLLED_BACK,
    UNCHANGED,
    Decision,
    Gate,
    Metrics,
    add_decision,
    check_gate,
    next_number,
    read_decisions,
    write_table,
)

MODELS = Path("models")
BESIDE = (METRICS, REPORT, Path("params.yaml"), Path("dvc.lock"))


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A trained model with what was measured of it."""

    experiment: str
    tables: dict[str, Metrics]
    files: dict[str, Path]
    model: str
    test_reactions: int


def candidate_of(row: str) -> Candidate:
    """Read what stands in the workspace.

    Raises
    ------
    CommandError
        If there are no metrics or weights.
    """
    weights = sorted(MODELS.glob(f"*/{row}/*/weights.safetensors"))
    if not METRICS.exists() or not weights:
        raise CommandError(f"no {METRICS} or no weights of {row} in {MODELS}: reproduce first")
    facts = _read_json(METRICS)
    pooled = METRICS.with_name("pacmo.json")
    files = {path.as_posix(): path for path in (*weights, *BESIDE) if path.exists()}
    return Candidate(
        experiment=facts["experiment"],
        tables=facts["pacmo"],
        files=files,
        model=promotion.model_hash(weights),
        test_reactions=_read_json(pooled)["test_reactions"] if pooled.exists() else 0,
    )


def decide(gate: Gate) -> Decision:
    """Judge what stands in the workspace against what is current, and act on it.

    The caller holds the writers' lock.
    """
    settle()
    found = candidate_of(gate.row)
    decisions, _ = read_decisions(DECISIONS)
    now_current = promotion.current_model(SHELF)
    number = _next_number()
    verdict, reasons = _judge(found, decisions, now_current, gate)
    if verdict == PROMOTED:
        promotion.store_model(SHELF, number, found.files)
    decision = Decision(
        number=number,
        at=now(),
        verdict=verdict,
        reasons=tuple(reasons),
        model=found.model,
        current_model=number if verdict == PROMOTED else now_current,
        experiment=found.experiment,
        test_reactions=found.test_reactions,
        metrics=_judged(found, gate),
    )
    return _write(decision)


def roll_back(why: str) -> Decision:
    """Make the model promoted before the current one current again, weights and all.

    The one taken back stays among the promoted models and is not promoted again.

    Raises
    ------
    CommandError
        If there is none before it.
    """
    settle()
    decisions, _ = read_decisions(DECISIONS)
    now_current = promotion.current_model(SHELF)
    withdrawn = _withdrawn(decisions)
    models = {d.current_model: d for d in decisions if d.verdict == PROMOTED}
    earlier = [
        number
        for number in promotion.list_models(SHELF)
        if number < now_current and number in models and models[number].model not in withdrawn
    ]
    if not earlier:
        raise CommandError(f"no model was promoted before the current one, {now_current}")
    back, gone = models[earlier[-1]], models[now_current]
    decision = Decision(
        number=_next_number(),
        at=now(),
        verdict=ROLLED_BACK,
        reasons=(f"from {gone.current_model} to {back.current_model}: {why}",),
        model=gone.model,
        current_model=back.current_model,
        experiment=back.experiment,
        test_reactions=back.test_reactions,
        metrics=back.metrics,
    )
    return _write(decision)


def settle() -> None:
    """Make good what a kill or a fault left: the link, the table."""
    decisions, broken = read_decisions(DECISIONS)
    for fault in broken:
        fault.file.replace(fault.file.with_suffix(".broken"))
    if decisions and decisions[-1].current_model not in (0, promotion.current_model(SHELF)):
        promotion.set_current_model(SHELF, decisions[-1].current_model)
    if decisions:
        write_table(DECISIONS)


def _judge(
    found: Candidate, decisions: list[Decision], now_current: int, gate: Gate
) -> tuple[str, list[str]]:
    withdrawn = _withdrawn(decisions)
    if found.model in withdrawn:
        return REJECTED, [f"these weights were rolled back on {withdrawn[found.model].at}"]
    current = {d.current_model: d for d in decisions if d.verdict == PROMOTED}.get(now_current)
    if current is not None and current.model == found.model:
        return UNCHANGED, []
    same = current is not None and current.experiment == found.experiment
    tables = _read_json(SHELF / promotion.CURRENT_LINK / METRICS)["pacmo"] if same else None
    reasons = check_gate(found.tables, tables, gate)
    return (REJECTED if reasons else PROMOTED), reasons


def _next_number() -> int:
    # A process killed between copy and decision leaves a folder without a decision.
    return max(next_number(DECISIONS), max(promotion.list_models(SHELF), default=0) + 1)


def _withdrawn(decisions: list[Decision]) -> dict[str, Decision]:
    return {d.model: d for d in decisions if d.verdict == ROLLED_BACK}


def _judged(found: Candidate, gate: Gate) -> dict[str, dict[str, float]]:
    names = (*gate.metrics, "f2id", "f2id_floor")
    return {name: dict(found.tables[gate.row][name]) for name in dict.fromkeys(names)}


def _write(decision: Decision) -> Decision:
    add_decision(DECISIONS, decision)
    if decision.current_model:
        promotion.set_current_model(SHELF, decision.current_model)
    write_page(PAGE, read_decisions(DECISIONS)[0])
    return decision


def _read_json(path: Path) -> dict[str, Any]:
    facts: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return facts
