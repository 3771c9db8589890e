"""What a person reads on Prefect's page: tables and links. By hand there is no page."""

import json
from pathlib import Path
from typing import Any

from prefect.artifacts import (
    create_link_artifact,
    create_markdown_artifact,
    create_table_artifact,
)
from prefect.context import FlowRunContext

from pacmo_core.figures.columns import MAIN_COLUMNS
from pacmo_core.figures.tables import markdown_table
from pacmo_core.project.workspace import REPORT


def publish(details: Path) -> None:
    """Publish the table of ``reports/details.json`` and a link to the report as artifacts."""
    if FlowRunContext.get() is None or not details.exists():
        return
    facts = json.loads(details.read_text(encoding="utf-8"))
    tables = [f"## Reactions\n\n{markdown_table(main_columns(facts['pacmo']['rows']))}"]
    title = f"# {facts['experiment']}\n\n"
    create_markdown_artifact(title + "\n\n".join(tables), key="metrics", description="Metrics")
    link_to(REPORT, "report")


def put_table(key: str, rows: list[dict[str, Any]], description: str) -> None:
    """Put a table on the page."""
    if FlowRunContext.get() is not None:
        create_table_artifact(rows, key=key, description=description)


def link_to(page: Path, key: str) -> None:
    """Put a link to a page of ours on Prefect's."""
    if FlowRunContext.get() is not None and page.exists():
        create_link_artifact(page.resolve().as_uri(), key=key, link_text=page.as_posix())


def main_columns(rows: dict[str, Any]) -> dict[str, Any]:
    """Leave out what a first look does not need."""
    return {row: {c: cells[c] for c in MAIN_COLUMNS if c in cells} for row, cells in rows.items()}
