"""What is trusted: the bytes that stages made here, and what the store holds in the end."""

import shutil
import socket
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import httpx
import pytest

from tests.flows.projects import drop, make_project, run_nightly

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("prefect_server")]
MADE = (Path("sides.txt"), Path("models"), Path("reports"))
CURRENT = Path("models/1/pacmo/1/weights.safetensors")


@pytest.fixture
def project(tmp_path, monkeypatch):
    make_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def s3(monkeypatch):
    """Start a store that speaks S3, on loopback, with one bucket."""
    if not find_spec("moto") or not find_spec("dvc_s3"):
        pytest.skip("moto[server] and dvc-s3 are not installed")
    with socket.socket() as door:
        door.bind(("127.0.0.1", 0))
        port = door.getsockname()[1]
    address = f"http://127.0.0.1:{port}"
    keys = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_DEFAULT_REGION")
    for name, value in zip(keys, ("test", "test", "us-east-1"), strict=True):
        monkeypatch.setenv(name, value)
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        wait_for(address)
        assert httpx.put(f"{address}/store").status_code == 200
        yield address
        server.kill()


def wait_for(address: str) -> None:
    deadline = time.monotonic() + 90
    while time.monotonic() < deadline:
        try:
            httpx.get(address)
        except httpx.ConnectError:
            time.sleep(0.2)
        else:
            return
    pytest.fail(f"nothing answers at {address}")


def dvc(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "dvc", *words], check=True, capture_output=True)


def there_and_back() -> None:
    """Push by a night, lose all that was made and the cache with it, and pull."""
    drop(Path(), range(1))
    assert run_nightly().facts["pushed"]
    made = CURRENT.read_bytes()
    for path in (*MADE, Path(".dvc/cache")):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    dvc("pull")
    assert CURRENT.read_bytes() == made
    assert run_nightly().facts["stages"] == []


def test_outputs_of_a_nightly_are_pulled_from_a_folder(project, tmp_path_factory):
    dvc("remote", "add", "-q", "-d", "store", str(tmp_path_factory.mktemp("remote")))
    there_and_back()


def test_outputs_of_a_nightly_are_pulled_from_s3(project, s3):
    dvc("remote", "add", "-q", "-d", "store", "s3://store/pacmo")
    dvc("remote", "modify", "-q", "store", "endpointurl", s3)
    there_and_back()
    found = httpx.get(f"{s3}/store?list-type=2&prefix=pacmo/files/md5").text
    assert found.count("<Key>") >= 3
