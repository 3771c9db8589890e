"""Serve the deployments of ``prefect.yaml`` on their schedules, until ended.

    python -m flows.serve [--port 4200]

Starts a Prefect server on this machine if none is there: without one a schedule fires nothing. A
night that was missed while nothing served is caught up at once, and once.
"""

import argparse
import asyncio
import importlib
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from prefect import serve
from prefect.client.schemas.objects import ConcurrencyLimitConfig
from prefect.client.schemas.schedules import CronSchedule
from prefect.deployments import run_deployment
from prefect.deployments.runner import RunnerDeployment
from prefect.types.entrypoint import EntrypointType
from ruamel.yaml import YAML

from flows.ending import ending
from flows.nightly import is_missed
from flows.server import HOME, PORT, QUIET, a_server
from pacmo_core.project.records import read_runs
from pacmo_core.project.workspace import LOG, RUNS, configure_logging, log_event

DEPLOYMENTS = Path("prefect.yaml")


def read_deployments(path: Path = DEPLOYMENTS) -> list[dict[str, Any]]:
    """Read what is to run when."""
    found: list[dict[str, Any]] = YAML(typ="safe").load(path)["deployments"]
    return found


def deployment_of(facts: dict[str, Any]) -> RunnerDeployment:
    """Make of one entry of ``prefect.yaml`` what ``prefect.serve`` takes."""
    file, _, name = facts["entrypoint"].partition(":")
    module = importlib.import_module(file.removesuffix(".py").replace("/", "."))
    deployment: RunnerDeployment = getattr(module, name).to_deployment(
        name=facts["name"],
        description=facts["description"],
        parameters=facts["parameters"],
        schedules=[CronSchedule(**schedule) for schedule in facts["schedules"]],
        concurrency_limit=ConcurrencyLimitConfig(**facts["concurrency_limit"]),
        # By module, as a run is started in a process of its own, wherever that stands.
        entrypoint_type=EntrypointType.MODULE_PATH,
    )
    return deployment


def catches_up(facts: dict[str, Any], now: datetime) -> bool:
    """Tell whether a deployment's schedule asked for a night that never began."""
    runs = read_runs(RUNS)
    return facts["name"] == "nightly" and any(
        asyncio.run(is_missed(s["cron"], s["timezone"], runs, now)) for s in facts["schedules"]
    )


def serve_all(port: int) -> None:
    """Serve until ended."""
    configure_logging(LOG)
    with a_server(port):
        entries = read_deployments()
        missed = [entry for entry in entries if catches_up(entry, datetime.now(UTC))]
        deployments = [deployment_of(entry) for entry in entries]
        for entry in missed:
            log_event(f"{entry['name']} was missed: it is caught up now", deployment=entry["name"])
            _start_now(entry)
        # Schedules stay active when this ends, so that a server which goes on counts late nights.
        serve(*deployments, pause_on_shutdown=False, print_starting_message=False)


def _start_now(entry: dict[str, Any]) -> None:
    deployment = deployment_of(entry)
    deployment.apply()
    run_deployment(f"{deployment.flow_name}/{deployment.name}", timeout=0, as_subflow=False)


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, default=PORT)
    port = parser.parse_args().port
    os.environ.update(QUIET)
    os.environ.setdefault("PREFECT_HOME", str(HOME.resolve()))
    return ending(lambda: serve_all(port))


if __name__ == "__main__":
    raise SystemExit(main())
