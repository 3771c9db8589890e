"""Promote a trained model, hold it back, or roll back to the one promoted before.

The copy of a model is prepared, its decision is written, then the copy and the link
``promoted/current`` get their places; ``repair_promotion`` finishes this where the process was
killed after the decision. What decides is the gate
(``pacmo_core/promotion.py``).
"""

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pacmo_core import promotion
from pacmo_core.data.limits import printable
from pacmo_core.figures.curves import Curve
from pacmo_core.figures.history import DecisionRow, render_history
from pacmo_core.project.records import utc_now
from pacmo_core.project.workspace import (
    DECISIONS,
    DETAILS,
    HISTORY_PAGE,
    METRICS,
    PROMOTED_MODELS,
    REPORT,
    CommandError,
    log_event,
)
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
from pacmo_core.store.files import write_text

MODELS = Path("models")
PROMOTED_FILES = (METRICS, DETAILS, REPORT, Path("params.yaml"), Path("dvc.lock"))


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A trained model with its metrics.

    Parameters
    ----------
    experiment : name
    tables : metrics by row of the table of reaction models
    files : copied at a promotion, by path in the folder of the promoted model
    model : SHA-256 of the weights
    test_reactions : number of reactions behind the metrics
    """

    experiment: str
    tables: dict[str, Metrics]
    files: dict[str, Path]
    model: str
    test_reactions: int


def read_candidate(row: str) -> Candidate:
    """Read the model in the workspace.

    Parameters
    ----------
    row : the model's row in the table of metrics

    Raises
    ------
    CommandError
        If there are no metrics or weights.
    """
    weights = sorted(MODELS.glob(f"*/{row}/*/weights.safetensors"))
    if not DETAILS.exists() or not weights:
        raise CommandError(f"no {DETAILS} or no weights of {row} in {MODELS}: run ./run first")
    experiment, tables = _read_details(DETAILS)
    pooled = DETAILS.with_name("pacmo.json")
    files = {path.as_posix(): path for path in (*weights, *PROMOTED_FILES) if path.exists()}
    return Candidate(
        experiment=experiment,
        tables=tables,
        files=files,
        model=promotion.model_hash(weights),
        test_reactions=_read_test_reactions(pooled) if pooled.exists() else 0,
    )


def decide_promotion(gate: Gate) -> Decision:
    """Compare the model in the workspace with the current one; promote it or hold it back.

    The caller holds the writer lock.
    """
    repair_promotion()
    candidate = read_candidate(gate.row)
    decisions, _ = read_decisions(DECISIONS)
    current_number = promotion.current_model(PROMOTED_MODELS)
    number = _next_number()
    verdict, reasons = _verdict(candidate, decisions, current_number, gate)
    if verdict == PROMOTED:
        promotion.prepare_model(PROMOTED_MODELS, number, candidate.files)
    decision = Decision(
        number=number,
        at=utc_now(),
        verdict=verdict,
        reasons=tuple(reasons),
        model=candidate.model,
        current_model=number if verdict == PROMOTED else current_number,
        experiment=candidate.experiment,
        test_reactions=candidate.test_reactions,
        metrics=promotion.compared_metrics(candidate.tables, gate),
    )
    return _write(decision)


def roll_back(why: str) -> Decision:
    """Make the model promoted before the current one current again, with its weights.

    The withdrawn one stays in the folder of promoted models and is not promoted again.

    Parameters
    ----------
    why : reason, written into the decision

    Raises
    ------
    CommandError
        If no model was promoted before it.
    """
    repair_promotion()
    decisions, _ = read_decisions(DECISIONS)
    current_number = promotion.current_model(PROMOTED_MODELS)
    withdrawn = _withdrawn(decisions)
    models = {d.current_model: d for d in decisions if d.verdict == PROMOTED}
    earlier = [
        number
        for number in promotion.list_models(PROMOTED_MODELS)
        if number < current_number and number in models and models[number].model not in withdrawn
    ]
    if not earlier or current_number not in models:
        raise CommandError(f"no model was promoted before the current one, {current_number}")
    restored, replaced = models[earlier[-1]], models[current_number]
    decision = Decision(
        number=_next_number(),
        at=utc_now(),
        verdict=ROLLED_BACK,
        reasons=(printable(f"from {replaced.current_model} to {restored.current_model}: {why}"),),
        model=replaced.model,
        current_model=restored.current_model,
        experiment=restored.experiment,
        test_reactions=restored.test_reactions,
        metrics=restored.metrics,
    )
    return _write(decision)


def repair_promotion() -> None:
    """Repair what a killed process left: model, link and table; set wrong decisions aside."""
    decisions, broken = read_decisions(DECISIONS)
    for fault in broken:
        _set_aside(fault.file, fault.reason)
    if decisions and decisions[-1].verdict == PROMOTED:
        promotion.publish_model(PROMOTED_MODELS, decisions[-1].number)
    promotion.remove_prepared_models(PROMOTED_MODELS)
    models = promotion.list_models(PROMOTED_MODELS)
    # The model of the last decision is current and never removed; so this decision is wrong.
    while decisions and decisions[-1].current_model not in (0, *models):
        wrong = decisions.pop()
        reason = f"there is no model {wrong.current_model}"
        _set_aside(DECISIONS / f"{wrong.number:06d}.json", reason)
    if decisions and decisions[-1].current_model:
        promotion.set_current_model(PROMOTED_MODELS, decisions[-1].current_model)
    if decisions:
        write_table(DECISIONS)


def _set_aside(file: Path, reason: str) -> None:
    log_event(f"set aside {file}: {reason}", logging.WARNING)
    file.replace(file.with_suffix(".broken"))


def _verdict(
    candidate: Candidate, decisions: list[Decision], current_number: int, gate: Gate
) -> tuple[str, list[str]]:
    withdrawn = _withdrawn(decisions)
    if candidate.model in withdrawn:
        return REJECTED, [f"these weights were rolled back on {withdrawn[candidate.model].at}"]
    current = {d.current_model: d for d in decisions if d.verdict == PROMOTED}.get(current_number)
    if current is not None and current.model == candidate.model:
        return UNCHANGED, []
    same = current is not None and current.experiment == candidate.experiment
    details = PROMOTED_MODELS / promotion.CURRENT_LINK / DETAILS
    tables = _read_details(details)[1] if same else None
    reasons = check_gate(candidate.tables, tables, gate)
    return (REJECTED if reasons else PROMOTED), reasons


def _next_number() -> int:
    # A process killed between copying a model and its decision leaves a folder without decision.
    return max(next_number(DECISIONS), max(promotion.list_models(PROMOTED_MODELS), default=0) + 1)


def _withdrawn(decisions: list[Decision]) -> dict[str, Decision]:
    return {d.model: d for d in decisions if d.verdict == ROLLED_BACK}


def _write(decision: Decision) -> Decision:
    add_decision(DECISIONS, decision)
    promotion.publish_model(PROMOTED_MODELS, decision.number)
    if decision.current_model:
        promotion.set_current_model(PROMOTED_MODELS, decision.current_model)
    write_history_page(HISTORY_PAGE, read_decisions(DECISIONS)[0])
    return decision


def _read_details(path: Path) -> tuple[str, dict[str, Metrics]]:
    """Read the name of the experiment, and the metrics of the reaction models by row."""
    content = _read_json(path)
    pacmo = content.get("pacmo")
    rows = pacmo.get("rows") if isinstance(pacmo, dict) else None
    if not isinstance(rows, dict) or not all(isinstance(row, dict) for row in rows.values()):
        raise CommandError(f"{path}: no table of metrics (pacmo, rows)")
    if not isinstance(content.get("experiment"), str):
        raise CommandError(f"{path}: no name of an experiment")
    return content["experiment"], rows


def _read_test_reactions(path: Path) -> int:
    count = _read_json(path).get("test_reactions")
    if not promotion.is_count(count):
        raise CommandError(f"{path}: wanted a number of test_reactions; got {count!s:.60}")
    return count


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise CommandError(f"{path}: not JSON: {error}") from error
    if not isinstance(content, dict):
        raise CommandError(f"{path}: wanted an object, got {type(content).__name__}")
    return content


def write_history_page(path: Path, decisions: list[Decision]) -> None:
    """Write the page of decisions: metrics over time, and each decision with its reasons."""
    write_text(path, render_history(metrics_over_time(decisions), history_rows(decisions)))


def metrics_over_time(decisions: list[Decision]) -> Curve | None:
    """Return the mean of each metric by decision; None without decisions.

    A roll-back has no new metrics and is omitted.
    """
    measured = [decision for decision in decisions if decision.verdict != ROLLED_BACK]
    if not measured:
        return None
    names = dict.fromkeys(name for decision in measured for name in decision.metrics)
    terms = {
        name: [d.metrics.get(name, {}).get("mean", float("nan")) for d in measured]
        for name in names
    }
    return Curve([float(d.number) for d in measured], terms, x_label="decision")


def history_rows(decisions: list[Decision]) -> list[DecisionRow]:
    """Return table rows of the decisions, the last one first."""
    return [
        DecisionRow(
            d.number, d.at, d.experiment, d.verdict, d.reasons, d.model[:12], d.current_model
        )
        for d in reversed(decisions)
    ]
