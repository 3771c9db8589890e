"""The Prefect server of a run: one that is configured, one that is running, or a temporary one.

Nothing here imports Prefect: the process that starts a server and waits for it is small.
"""

import http.client
import os
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from pacmo_core.project.processes import start_process
from pacmo_core.project.workspace import CommandError

PORT = 4200  # Prefect's default
_HOME = Path(".prefect")
_STARTUP_S = 120.0
_REQUEST_S = 5.0


class ServerError(CommandError):
    """There is no healthy Prefect server."""


@dataclass(frozen=True)
class Server:
    """A Prefect server.

    Parameters
    ----------
    address : of its API
    process : the server, if this run has started it
    """

    address: str
    process: "subprocess.Popen[bytes] | None" = None

    @property
    def page(self) -> str:
        """Address of its web page."""
        return self.address.removesuffix("/api")


def prefect_environment() -> dict[str, str]:
    """Return Prefect's settings: its home in the project, no analytics, our log on its page."""
    return {
        "DO_NOT_TRACK": "1",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "PREFECT_LOGGING_EXTRA_LOGGERS": "pacmo",
        "PREFECT_HOME": os.environ.get("PREFECT_HOME", str(_HOME.resolve())),
    }


def find_server(port: int = PORT) -> Server | None:
    """Return the server that the settings name, or the one that runs on a port of this machine.

    Raises
    ------
    ServerError
        If the settings name a server and it does not answer.
    """
    named = _named_address()
    if named:
        if not is_healthy(named):
            raise ServerError(f"PREFECT_API_URL is {named}; no Prefect server responds there")
        return Server(named)
    local = _local_address(port)
    return Server(local) if is_healthy(local) else None


def start_server(mark: Mapping[str, str], port: int = PORT) -> Server:
    """Start a server for schedules: with Prefect's services and its database in ``.prefect``.

    Raises
    ------
    ServerError
        If another program uses the port.
    """
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", port)) == 0:
            raise ServerError(f"another program uses port {port}: give --port")
    return _start(mark, port, [], {})


def start_temporary_server(mark: Mapping[str, str]) -> Server:
    """Start a server that ends with the run, on a free port and with its own database.

    With the database of ``start_server``, and flows being served at the same time, two servers
    would write to one SQLite file.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    database = Path(prefect_environment()["PREFECT_HOME"]) / "run.db"
    connection = f"sqlite+aiosqlite:///{database}"
    # Services are for schedules, late runs and events: no run of its own needs them.
    return _start(
        mark, port, ["--no-services"], {"PREFECT_API_DATABASE_CONNECTION_URL": connection}
    )


def wait_until_healthy(server: Server) -> None:
    """Wait for a server that was started here.

    Raises
    ------
    ServerError
        If it ends, or does not answer within two minutes.
    """
    deadline = time.monotonic() + _STARTUP_S
    while not is_healthy(server.address):
        ended = server.process is not None and server.process.poll() is not None
        if ended or time.monotonic() > deadline:
            log = Path(prefect_environment()["PREFECT_HOME"]) / "server.log"
            raise ServerError(f"the Prefect server did not start; see {log}")
        time.sleep(0.1)


def is_healthy(address: str) -> bool:
    """Return whether a Prefect server answers at an address."""
    parts = urlsplit(address)
    secure = parts.scheme == "https"
    kind = http.client.HTTPSConnection if secure else http.client.HTTPConnection
    connection = kind(parts.hostname or "", parts.port, timeout=_REQUEST_S)
    try:
        connection.request("GET", f"{parts.path}/health")
        return connection.getresponse().read() == b"true"
    except (OSError, http.client.HTTPException):
        return False
    finally:
        connection.close()


def _start(
    mark: Mapping[str, str], port: int, options: list[str], settings: Mapping[str, str]
) -> Server:
    # The port by the environment: given as an option, the web page would still call port 4200.
    environment = {
        **os.environ,
        **prefect_environment(),
        **settings,
        "PREFECT_SERVER_API_HOST": "127.0.0.1",
        "PREFECT_SERVER_API_PORT": str(port),
    }
    home = Path(environment["PREFECT_HOME"])
    home.mkdir(parents=True, exist_ok=True)
    with (home / "server.log").open("ab") as log:
        command = [sys.executable, "-m", "prefect", "server", "start", *options]
        process = start_process(command, mark, env=environment, stdout=log, stderr=log)
    return Server(_local_address(port), process)


def _local_address(port: int) -> str:
    return f"http://127.0.0.1:{port}/api"


def _named_address() -> str:
    """Return ``PREFECT_API_URL`` of the environment or else of Prefect's active profile."""
    named = os.environ.get("PREFECT_API_URL")
    profiles = Path(prefect_environment()["PREFECT_HOME"]) / "profiles.toml"
    if named or not profiles.exists():
        return named or ""
    facts = tomllib.loads(profiles.read_text(encoding="utf-8"))
    profile = facts.get("profiles", {}).get(facts.get("active", ""), {})
    return str(profile.get("PREFECT_API_URL", ""))
