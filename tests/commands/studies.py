"""Small invented studies, and a server of one in a process of its own."""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx

from pacmo_core.commands.study_store import GENERATED, REAL, Item, write_study
from pacmo_core.figures.viewer import Scene, packed_scenes
from tests.figures.samples import interaction

PATIENCE_S = 120.0


FRAMES = {REAL: 12, GENERATED: 15}


def small_study(path: Path, sources: int = 20) -> Path:
    """Write a study whose clips tell what they are by their number of frames alone."""
    items = [
        Item(kind, f"s{k}", json.dumps(packed_scenes([_scene(k, kind)], contact=0.0)))
        for k in range(sources)
        for kind in (REAL, GENERATED)
    ]
    write_study(path, items, {"reactions": "none.parquet", "reactions_sha256": "0" * 64})
    return path


def _scene(random_seed: int, kind: str) -> Scene:
    return Scene.of("", interaction(random_seed, n_frames=FRAMES[kind]))


@contextmanager
def served(
    path: Path, port: int = 0, *options: str
) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Serve a study as the command does; hand out its address and the process."""
    port = port or free_port()
    # Not by the whole command, which loads what reactions need.
    words = [
        "-c",
        "from pacmo_core.commands.study import app; app()",
        "serve",
        str(path),
        "--port",
        str(port),
    ]
    unlimited = ["--rate", "100000", "--burst", "100000", "--per-address", "100000"]
    command = [sys.executable, *words, *unlimited, *options]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        try:
            address = f"http://127.0.0.1:{port}"
            wait_for(address, process)
            yield address, process
        finally:
            process.kill()


def wait_for(address: str, process: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until and process.poll() is None:
        try:
            httpx.get(address)
        except httpx.TransportError:
            time.sleep(0.1)
        else:
            return
    raise TimeoutError(f"{address} never answered; the process says {process.poll()}")


def free_port() -> int:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        return int(held.getsockname()[1])
