"""A Prefect server on this machine: the one that is there, or one of our own."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
from prefect.settings import PREFECT_API_URL, temporary_settings

from pacmo_core.project.workspace import CommandError, log_event

HOME = Path(".prefect")
PORT = 4200
_PATIENCE_S = 120.0
QUIET = {
    "DO_NOT_TRACK": "1",
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "PREFECT_LOGGING_EXTRA_LOGGERS": "pacmo",  # our log lines on the page too
}


class ServerError(CommandError):
    """No Prefect server answers."""


@contextmanager
def a_server(port: int = PORT) -> Iterator[str]:
    """Give the address of a server that answers; ours is ended with the block.

    Raises
    ------
    ServerError
        If the settings name a server and it does not answer, or our own does not come up.
    """
    named = PREFECT_API_URL.value()
    if named:
        if not answers(named):
            raise ServerError(f"PREFECT_API_URL is {named}, and no Prefect server answers there")
        yield named
        return
    address = f"http://127.0.0.1:{port}/api"
    if answers(address):
        process = None
    elif _is_taken(port):
        raise ServerError(f"port {port} is another program's: give --port")
    else:
        process = _start(port)
    os.environ["PREFECT_API_URL"] = address  # for the processes that runs are started in
    try:
        if process is not None:
            _wait(process, address)
        with temporary_settings({PREFECT_API_URL: address}):
            yield address
    finally:
        del os.environ["PREFECT_API_URL"]
        if process is not None:
            process.terminate()
            process.wait()


def answers(address: str) -> bool:
    """Tell whether a Prefect server answers there."""
    try:
        return httpx.get(f"{address}/health", timeout=5.0).text == "true"
    except httpx.HTTPError:
        return False


def _is_taken(port: int) -> bool:
    with socket.socket() as door:
        return door.connect_ex(("127.0.0.1", port)) == 0


def _start(port: int) -> "subprocess.Popen[bytes]":
    home = os.environ.get("PREFECT_HOME", str(HOME.resolve()))
    # The port by the environment: given as an option, the page would still call 4200.
    environment = {
        **os.environ,
        **QUIET,
        "PREFECT_HOME": home,
        "PREFECT_SERVER_API_HOST": "127.0.0.1",
        "PREFECT_SERVER_API_PORT": str(port),
    }
    Path(home).mkdir(parents=True, exist_ok=True)
    with (Path(home) / "server.log").open("ab") as out:
        command = [sys.executable, "-m", "prefect", "server", "start"]
        return subprocess.Popen(command, stdout=out, stderr=out, env=environment)


def _wait(process: "subprocess.Popen[bytes]", address: str) -> None:
    deadline = time.monotonic() + _PATIENCE_S
    while not answers(address):
        if process.poll() is not None or time.monotonic() > deadline:
            raise ServerError(f"the Prefect server did not come up: {HOME}/server.log")
        time.sleep(0.2)
    log_event("Prefect server is up", page=address.removesuffix("/api"))
