"""What the tests of whole datasets share: small archives, and the command run in this process."""

import hashlib
import io
import random
import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import pacmo_core.commands.fetch
from pacmo_core.commands.cli import app
from tests.commands.site import Site

TAKE_1, TAKE_2 = b"1,0.5,0.5\r\n", b"2,0.25,0.5\r\n"
PLACE_1 = "sbu/s01s02/01/001/skeleton_pos.txt"
PLACE_2 = "sbu/s01s02/08/002/skeleton_pos.txt"


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def zipped(members: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


GOOD_ZIP = zipped(
    {
        "s01s02/01/001/skeleton_pos.txt": TAKE_1,
        "s01s02/01/001/rgb_000001.png": random.Random(0).randbytes(300_000),
        "s01s02/08/002/skeleton_pos.txt": TAKE_2,
    }
)


def know(monkeypatch: pytest.MonkeyPatch, sums: dict[str, str]) -> None:
    monkeypatch.setattr(pacmo_core.commands.fetch, "shipped_checksums", lambda: sums)


def pacmo(server: Site, what: str, dest: Path, part: str, *more: str) -> Result:
    server.asked.clear()
    server.sent = 0
    words = ["fetch", what, str(dest), "--base-url", server.url, "--only", part, *more]
    return CliRunner().invoke(app, words)


def sbu(server: Site, dest: Path, *more: str) -> Result:
    return pacmo(server, "sbu", dest, "s01s02", *more)


def cmu(server: Site, dest: Path, *more: str) -> Result:
    return pacmo(server, "cmu-two-person", dest, "33", *more)


def files_below(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
