"""Truth: the server's own memory and answers, asked by clients that mean no good."""

import asyncio
import resource
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import httpx
import pytest
import uvicorn
from fastapi import FastAPI

from benchmarks.study import MEGABYTE, N_HALF_OPEN, connect, memory_growth
from pacmo_core.commands.study_limits import RateLimiter, network_of
from pacmo_core.commands.study_server import StudySettings, create_app, run_server
from pacmo_core.commands.study_store import Study
from tests.commands.studies import served, small_study

STATUS = Path("/proc/self/status")


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return small_study(tmp_path / "s.sqlite")


def post(app: FastAPI, address: str, path: str, content: object) -> httpx.Response:
    """Ask a server in this process from an address."""

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app, client=(address, 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://study") as web:
            return await web.post(path, json=content)

    return asyncio.run(ask())


def app_of(study: Path, people: int, per_address: int) -> FastAPI:
    settings = StudySettings(per_person=14, people=people, per_address=per_address)
    return create_app(Study(study), settings, RateLimiter(1e6, 1e6))


@pytest.mark.slow
@pytest.mark.skipif(not STATUS.exists(), reason="memory is read from /proc")
def test_half_a_gigabyte_in_one_request_is_refused_and_never_held(study: Path) -> None:
    growth, said = memory_growth(study)
    assert growth < 5 * MEGABYTE
    # The rest of a refused request may reset the connection before its answer is read.
    assert set(said) <= {b"413", b"400", b"422", b""}


class Unread(httpx.AsyncByteStream):
    """A body that nobody may read."""

    async def __aiter__(self) -> AsyncIterator[bytes]:
        pytest.fail("the body was read")
        yield b""


@pytest.mark.parametrize("method", ["POST", "GET"])
@pytest.mark.parametrize(
    "headers",
    [
        {"Transfer-Encoding": "chunked"},
        {"Transfer-Encoding": "chunked", "Content-Length": "10"},
        {"Content-Length": "1001"},
        {"Content-Length": "1e2"},
        {"Content-Length": "-1"},
        {"Content-Length": "²"},
    ],
)
def test_only_small_bodies_of_a_stated_length_are_read(
    study: Path, method: str, headers: dict[str, str]
) -> None:
    app = app_of(study, 9, 9)

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app)) as web:
            encoded = {name: value.encode("latin-1") for name, value in headers.items()}
            request = web.build_request(method, "http://study/answer", headers=encoded)
            request.stream = Unread()
            return await web.send(request)

    said = asyncio.run(ask())
    assert (said.status_code, said.headers["connection"]) == (413, "close")


@pytest.fixture
def many_files() -> Iterator[None]:
    """Let this process open more connections than the server keeps."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = N_HALF_OPEN + 500
    if hard != resource.RLIM_INFINITY and hard < wanted:
        pytest.skip(f"a process here may open {hard} files; this needs {wanted}")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, wanted), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.slow
@pytest.mark.usefixtures("many_files")
@pytest.mark.parametrize("begun", [b"", b"POST /answer HTTP/1.1\r\nHost: s\r\nContent-Le"])
def test_half_open_requests_keep_nobody_out(study: Path, begun: bytes) -> None:
    with served(study) as (address, _), ExitStack() as opened:
        for _ in range(N_HALF_OPEN):
            web = opened.enter_context(connect(address))
            with suppress(ConnectionError):
                web.sendall(begun)
        for _ in range(5):
            assert httpx.get(address, timeout=30).status_code == 200
            begun_study = httpx.post(f"{address}/begin", json={"consent": True}, timeout=30)
            assert begun_study.status_code == 200


def test_few_connections_are_accepted_before_open_ones_are_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said: dict[str, object] = {}
    monkeypatch.setattr(uvicorn, "run", lambda _, **options: said.update(options))
    run_server(FastAPI(), "127.0.0.1", 0)
    config = uvicorn.Config(FastAPI(), **said)  # type: ignore[arg-type]
    assert config.backlog <= 100


def test_one_address_cannot_take_the_places_of_all(study: Path) -> None:
    app = app_of(study, people=20, per_address=3)
    greedy = [post(app, "1.2.3.4", "/begin", {"consent": True}).status_code for _ in range(30)]
    assert greedy == [200] * 3 + [403] * 27
    assert post(app, "1.2.3.5", "/begin", {"consent": True}).status_code == 200


def test_no_response_repeats_what_a_request_claims(study: Path) -> None:
    app = app_of(study, people=20, per_address=3)

    async def ask(path: str) -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app)) as web:
            return await web.post(f"http://elsewhere.example/{path}", json={"consent": True})

    for path in ("begin/", "answer/", "nothing/"):
        said = asyncio.run(ask(path))
        assert said.status_code == 404
        assert "elsewhere" not in str(said.headers) + said.text


def test_addresses_of_one_subscriber_count_as_one() -> None:
    assert network_of("2001:db8:1:2::1") == network_of("2001:db8:1:2:ffff::9")
    assert network_of("2001:db8:1:2::1") != network_of("2001:db8:1:3::1")
    assert network_of("::ffff:1.2.3.4") == network_of("1.2.3.4") == "1.2.3.4"
    assert network_of("::ffff:1.2.3.4") != network_of("::ffff:1.2.3.5")
    assert network_of("testclient") == "testclient"


def test_the_file_of_a_study_is_its_owners_alone(study: Path) -> None:
    opened = Study(study)
    opened.begin("ann", lambda seen: [seen[0].item], 9)
    files = sorted(study.parent.glob("s.sqlite*"))
    assert len(files) > 1  # the journal, which holds answers too
    assert {file.stat().st_mode & 0o777 for file in files} == {0o600}


def test_on_a_full_disk_the_page_is_told_to_try_again_and_the_study_goes_on(study: Path) -> None:
    opened = Study(study)
    settings = StudySettings(per_person=14, people=1000, per_address=1000)
    app = create_app(opened, settings, RateLimiter(1e6, 1e6))
    (pages,) = opened._database.execute("PRAGMA page_count").fetchone()
    opened._database.execute(f"PRAGMA max_page_count = {pages}")
    codes = [post(app, "a", "/begin", {"consent": True}).status_code for _ in range(100)]
    assert set(codes) == {200, 503}
    opened._database.execute("PRAGMA max_page_count = 100000")
    assert post(app, "a", "/begin", {"consent": True}).status_code == 200
