"""Serve the deployments of ``prefect.yaml`` on their schedules, until interrupted.

    python -m flows.serve [--port 4200]

Starts a Prefect server on this machine if none is running: without a server no schedule starts
anything. A nightly that was missed while nothing was served is started at once. On Ctrl-C or
SIGTERM the server, the deployments and the runs that they have started end.
"""

import argparse
import asyncio
import importlib
import os
import sys
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

from flows.nightly import is_missed
from flows.run import RUN_VARIABLE, supervised
from flows.server import (
    PORT,
    Server,
    find_server,
    prefect_environment,
    start_server,
    wait_until_healthy,
)
from pacmo_core.project.processes import start_process
from pacmo_core.project.records import read_runs
from pacmo_core.project.workspace import (
    RUNS,
    configure_logging,
    errors_in_one_line,
    log_event,
)

DEPLOYMENTS = Path("prefect.yaml")


def read_deployments(path: Path = DEPLOYMENTS) -> list[dict[str, Any]]:
    """Read the deployments: what runs when."""
    entries: list[dict[str, Any]] = YAML(typ="safe").load(path)["deployments"]
    return entries


def make_deployment(entry: dict[str, Any]) -> RunnerDeployment:
    """Make a deployment that ``prefect.serve`` takes of an entry of ``prefect.yaml``."""
    file, _, name = entry["entrypoint"].partition(":")
    module = importlib.import_module(file.removesuffix(".py").replace("/", "."))
    deployment: RunnerDeployment = getattr(module, name).to_deployment(
        name=entry["name"],
        description=entry["description"],
        parameters=entry["parameters"],
        schedules=[CronSchedule(**schedule) for schedule in entry["schedules"]],
        concurrency_limit=ConcurrencyLimitConfig(**entry["concurrency_limit"]),
        # By module, as a run is a process of its own, whose script is Prefect's.
        entrypoint_type=EntrypointType.MODULE_PATH,
    )
    return deployment


def has_missed_nightly(entry: dict[str, Any], now: datetime) -> bool:
    """Return whether an entry is the nightly and did not start at its last scheduled time."""
    runs = read_runs(RUNS)
    return entry["name"] == "nightly" and any(
        asyncio.run(is_missed(schedule["cron"], schedule["timezone"], runs, now))
        for schedule in entry["schedules"]
    )


def serve_deployments() -> None:
    """Serve until the process is ended."""
    configure_logging()
    entries = read_deployments()
    deployments = [make_deployment(entry) for entry in entries]
    for entry in entries:
        if has_missed_nightly(entry, datetime.now(UTC)):
            log_event(f"{entry['name']} was missed and starts now")
            _start_now(make_deployment(entry))
    # Schedules stay active when this ends, so that a server that keeps running records late runs.
    serve(*deployments, pause_on_shutdown=False, print_starting_message=False)


def _start_now(deployment: RunnerDeployment) -> None:
    deployment.apply()
    run_deployment(f"{deployment.flow_name}/{deployment.name}", timeout=0, as_subflow=False)


def _lines(server: Server, entries: list[dict[str, Any]]) -> list[str]:
    """Return the address and the deployments as lines of text."""
    lines = [f"serving {DEPLOYMENTS} at {server.page}"]
    for entry in entries:
        times = ", ".join(f"{s['cron']} {s['timezone']}" for s in entry["schedules"])
        name = f"{Path(entry['entrypoint']).name.partition(':')[2]}/{entry['name']}"
        lines.append(f"  {name:22} {times or 'on request':18} {entry['description']}")
    example = "prefect deployment run reproduce/reproduce"
    return [*lines, f"start one now: PREFECT_API_URL={server.address} {example}"]


def _supervise(port: int) -> int:
    """Start the server, if there is none, and this module as a process that serves."""
    with supervised("python -m flows.serve") as mark, errors_in_one_line():
        server = find_server(port) or start_server(mark, port)
        wait_until_healthy(server)
        environment = {**os.environ, **prefect_environment(), "PREFECT_API_URL": server.address}
        sys.stdout.write("\n".join(_lines(server, read_deployments())) + "\n")
        sys.stdout.flush()
        command = [sys.executable, "-m", "flows.serve"]
        return start_process(command, mark, env=environment).wait()


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, default=PORT)
    options = parser.parse_args()
    if RUN_VARIABLE in os.environ:  # the process that _supervise starts
        with errors_in_one_line():
            serve_deployments()
        return 0
    return _supervise(options.port)


if __name__ == "__main__":
    raise SystemExit(main())
