"""Start a flow and end it: what ``./run`` does.

    python -m flows.run reproduce [--experiment NAME] [--force] [STAGE ...]
    python -m flows.run nightly [--experiment NAME]
    python -m flows.run retrain [MODEL ...]
    python -m flows.run prune

This process, the supervisor, imports neither Prefect nor torch. If no stage is stale it says so
and ends. Otherwise it starts a Prefect server, if none is running, and the flow in its own process.
It shows the events of the flow, and on Ctrl-C or SIGTERM it ends every process of the run.

Exit codes: 0 done, or nothing is stale; 1 failed; 2 wrong usage; 3 the gate rejected the model;
4 another run writes; 130 interrupted.
"""

import argparse
import importlib
import json
import logging
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from flows.progress import Display
from flows.server import (
    Server,
    find_server,
    prefect_environment,
    start_temporary_server,
    wait_until_healthy,
)
from pacmo_core.project.experiments import remove_unused_outputs, use_experiment
from pacmo_core.project.lock import (
    BusyError,
    check_unlocked,
    remove_dead_dvc_locks,
    writer_lock,
)
from pacmo_core.project.objects import remove_corrupt_objects
from pacmo_core.project.processes import end_on_signal, end_run, kill_marked, start_process
from pacmo_core.project.records import EXIT_CODES, INTERRUPTED, close_killed_runs, read_runs
from pacmo_core.project.stages import read_status, readable_dvc_lock, upstream_and_stale
from pacmo_core.project.workspace import (
    EVENTS_VARIABLE,
    EXIT_BUSY,
    EXIT_FAILED,
    HISTORY,
    LOCK,
    PARAMS,
    REPORT,
    RUNS,
    CommandError,
    configure_logging,
    log_event,
    one_line,
)
from pacmo_core.store.files import file_hash

RUN_VARIABLE = "PACMO_RUN"  # in the environment of every process of a run
FLOWS = {
    "reproduce": "flows.reproduce:reproduce",
    "nightly": "flows.nightly:nightly",
    "retrain": "flows.nightly:retrain",
    "prune": "flows.prune:prune",
}
FLOW_LOG = HISTORY / "flow.log"
_TERMINATE_S = 2.0


def main(words: Sequence[str] | None = None) -> int:
    """Read the command line and run a flow.

    Returns
    -------
    the exit code
    """
    options = vars(_parser().parse_args(words))
    job = options.pop("job")
    if job == "execute":
        return execute(options["entrypoint"], json.loads(options["arguments"]))
    with supervised() as mark:
        return _exit_code(lambda: _run_job(job, options, mark))


def run_flow(entrypoint: str, arguments: Mapping[str, Any], mark: Mapping[str, str]) -> int:
    """Run a flow in a process of its own and show its events.

    Parameters
    ----------
    entrypoint : MODULE:FUNCTION of the flow
    arguments : of the flow, JSON values
    mark : variables of the environment of its processes

    Returns
    -------
    the exit code
    """
    check_unlocked(LOCK)
    server = find_server() or start_temporary_server(mark)
    HISTORY.mkdir(exist_ok=True)
    read_end, write_end = os.pipe()
    environment = {
        **os.environ,
        **prefect_environment(),
        "PREFECT_API_URL": server.address,
        EVENTS_VARIABLE: str(write_end),
    }
    display = Display()
    with FLOW_LOG.open("wb") as log:
        process = start_process(
            [sys.executable, "-m", "flows.run", "execute", entrypoint, json.dumps(arguments)],
            mark,
            env=environment,
            stdout=log,
            stderr=log,
            pass_fds=(write_end,),
        )
    os.close(write_end)
    wait_until_healthy(server)
    if server.process is None or display.live:
        display.show({"event": f"Prefect: {server.page}", "level": "info"})
    display.follow(read_end)
    code = process.wait()
    if code and not display.last_error:
        # A bug: its traceback is in the log.
        sys.stderr.write(f"pacmo: the flow ended with {code}; see {FLOW_LOG}\n")
    return code if code >= 0 else EXIT_FAILED


@contextmanager
def supervised(command: str = "./run") -> Iterator[dict[str, str]]:
    """Return a mark for the processes of a run; end them after the block or on a signal.

    Parameters
    ----------
    command : that continues an interrupted run, for the message
    """
    mark = {RUN_VARIABLE: f"{LOCK.resolve()}:{os.getpid()}"}
    with end_on_signal(lambda: _interrupt(mark, command)):
        try:
            yield mark
        finally:
            kill_marked(mark, terminate_s=_TERMINATE_S)


def execute(entrypoint: str, arguments: Mapping[str, Any]) -> int:
    """Call a flow in this process, once its server is healthy.

    Returns
    -------
    the exit code
    """
    configure_logging()
    module, _, name = entrypoint.partition(":")
    return _exit_code(lambda: _call(getattr(importlib.import_module(module), name), arguments))


def _call(flow: Callable[..., object], arguments: Mapping[str, Any]) -> int:
    wait_until_healthy(Server(os.environ["PREFECT_API_URL"]))
    flow(**arguments)
    return EXIT_CODES[read_runs(RUNS)[-1].outcome]


def _run_job(job: str, options: dict[str, Any], mark: Mapping[str, str]) -> int:
    if job != "reproduce":
        return run_flow(FLOWS[job], options, mark)
    params_hash = _prepare(options)
    if not params_hash:
        return 0
    # The experiment is in use by now, unless another command takes the lock before the flow does.
    arguments = {**options, "experiment": "", "params_hash": params_hash}
    code = run_flow(FLOWS[job], arguments, mark)
    if not code and REPORT.exists():
        sys.stderr.write(f"report: {REPORT}; with the history of runs: {HISTORY / 'report.html'}\n")
    return code


def _prepare(options: Mapping[str, Any]) -> str:
    """Prepare the workspace; return the hash of the parameters to run.

    Returns an empty string, and says so, if nothing has to run.
    """
    targets = options["targets"]
    with writer_lock("check", LOCK):
        remove_dead_dvc_locks()
        saved = use_experiment(options["experiment"]) if options["experiment"] else None
        if saved:
            sys.stderr.write(f"{PARAMS} differed from its experiment: saved as {saved}\n")
        for path in remove_unused_outputs():
            sys.stderr.write(f"removed {path}, which {PARAMS} does not define\n")
        remove_corrupt_objects(skip_verified=True)
        params_hash = file_hash(PARAMS)
        if options["force"]:
            return params_hash
        status = read_status()
        n_stages = status.n_stages
        if status.reasons or targets:
            upstream, stale = readable_dvc_lock(lambda: upstream_and_stale(targets))
            n_stages = len(upstream)
            if stale & set(upstream):
                return params_hash
    report = f"; report: {REPORT}" if REPORT.exists() else ""
    sys.stdout.write(f"nothing is stale: {n_stages} stages are up to date{report}\n")
    return ""


def _interrupt(mark: Mapping[str, str], command: str) -> str:
    line = end_run(mark, command)
    # This process may hold the lock itself; then no flow has started.
    with suppress(BusyError), writer_lock("interrupted", LOCK):
        close_killed_runs(RUNS, INTERRUPTED)
    return line


def _exit_code(call: Callable[[], int]) -> int:
    try:
        return call()
    except BusyError as error:
        return _report(error, EXIT_BUSY)
    except (CommandError, OSError) as error:
        return _report(error, EXIT_FAILED)


def _report(error: Exception, code: int) -> int:
    if EVENTS_VARIABLE in os.environ:
        log_event(one_line(error), logging.ERROR)
    else:
        sys.stderr.write(f"pacmo: {one_line(error)}\n")
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="./run")
    jobs = parser.add_subparsers(dest="job", required=True, metavar="FLOW")
    reproduce = jobs.add_parser("reproduce", help="run the stale stages")
    reproduce.add_argument("targets", nargs="*", metavar="STAGE", help="none means all")
    reproduce.add_argument("--experiment", default="", help="whose parameters to use")
    reproduce.add_argument("--force", action="store_true", help="run them even if up to date")
    nightly = jobs.add_parser("nightly", help="take captures in, reproduce, compare, promote")
    nightly.add_argument("--experiment", default="", help="whose parameters to use")
    retrain = jobs.add_parser("retrain", help="train again, compare, promote")
    retrain.add_argument("models", nargs="*", metavar="MODEL", help="none means all")
    jobs.add_parser("prune", help="remove what is old and not needed")
    execute_job = jobs.add_parser("execute")
    execute_job.add_argument("entrypoint")
    execute_job.add_argument("arguments")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
