"""Bring targets up to date, each stale DVC stage as one Prefect task.

    python -m flows.reproduce [STAGE ...]

Which stage rests on which is written once, in ``dvc.yaml``; this flow only reads it. DVC decides
whether a stage runs, Prefect when and beside what. No retries: a stage that fails once fails
twice. The metrics table stands in Prefect's own page as an artifact.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from prefect import flow, task
from prefect.artifacts import create_markdown_artifact
from prefect.cache_policies import NO_CACHE
from prefect.futures import PrefectFuture
from prefect.task_runners import ThreadPoolTaskRunner

from flows.graph import stages_below, stale_stages
from pacmo_core.figures.columns import MAIN_COLUMNS
from pacmo_core.figures.tables import markdown_table

METRICS = Path("reports/metrics.json")


@task(task_run_name="{stage}", cache_policy=NO_CACHE, persist_result=False)
def reproduce_stage(stage: str) -> None:
    """Let DVC run one stage, or restore it from its cache."""
    # Stages overlap: DVC lets go of its lock while a stage's command runs, and the rest waits.
    dvc = [sys.executable, "-m", "dvc", "--wait-for-lock"]
    subprocess.run([*dvc, "repro", "--single-item", stage], check=True)


@task(cache_policy=NO_CACHE, persist_result=False)
def publish_metrics() -> None:
    """Put the tables of ``reports/metrics.json`` into Prefect's page."""
    metrics = json.loads(METRICS.read_text(encoding="utf-8"))
    tables = [
        f"## {section}\n\n{markdown_table(main_columns(rows))}"
        for section, rows in metrics.items()
        if section not in ("experiment", "data")
    ]
    title = f"# {metrics['experiment']}\n\n"
    create_markdown_artifact(title + "\n\n".join(tables), key="metrics", description="Metrics")


def main_columns(rows: dict[str, Any]) -> dict[str, Any]:
    """Leave out what a first look does not need."""
    return {row: {c: cells[c] for c in MAIN_COLUMNS if c in cells} for row, cells in rows.items()}


@flow(task_runner=ThreadPoolTaskRunner(max_workers=2), persist_result=False)
def reproduce(targets: list[str]) -> list[str]:
    """Reproduce ``targets`` (none: everything), side by side where the graph allows.

    Returns
    -------
    the stages that were stale, in the order in which they were submitted
    """
    stale = stale_stages()
    runs: dict[str, PrefectFuture[None]] = {}
    for stage, upstream in stages_below(targets).items():
        if stage in stale:
            before = [runs[name] for name in upstream if name in runs]
            runs[stage] = reproduce_stage.submit(stage, wait_for=before)
    for run in runs.values():
        run.result()  # wait() alone would call a flow complete though every task failed
    if METRICS.exists():
        publish_metrics()
    return list(runs)


if __name__ == "__main__":
    reproduce(sys.argv[1:])
