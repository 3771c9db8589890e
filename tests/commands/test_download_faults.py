"""Truth: what a loopback server was told to do wrong, and the words that a person needs."""

import socket

import httpx
import pytest

from pacmo_core.commands.download import MissingError, PartialFile, RetryPolicy, download
from pacmo_core.project.workspace import CommandError
from tests.commands.downloading import CONTENT, PATIENCE, get, stop_after
from tests.commands.site import Site


@pytest.mark.parametrize("faults", [[500], [503, 429], [416]])
def test_a_fault_that_passes_is_borne(site: Site, part: PartialFile, faults: list[int]) -> None:
    stop_after(site, part, 100_000)
    site.faults = list(faults)
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


def test_a_server_that_keeps_failing_is_given_up(site: Site, part: PartialFile) -> None:
    site.faults = [500] * 9
    with pytest.raises(CommandError, match=r"gave up .*HTTP 500.*run the same command again"):
        get(site.url, part)
    assert len(site.asked) == PATIENCE.attempts


def test_waits_double_from_one_failure_to_the_next(
    site: Site, part: PartialFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []
    monkeypatch.setattr("pacmo_core.commands.download.time.sleep", waits.append)
    site.faults = [500] * 3
    patience = RetryPolicy(attempts=9, first_wait=0.5, timeout=5.0)
    with httpx.Client(trust_env=False) as client:
        download(client, f"{site.url}/a.zip", part, patience, lambda done, total: None)
    assert waits == [0.5, 1.0, 2.0]


def test_a_missing_file_is_named_at_once(site: Site, part: PartialFile) -> None:
    del site.files["/a.zip"]
    with pytest.raises(MissingError, match=r"a\.zip: not on the server \(HTTP 404\)"):
        get(site.url, part)
    assert len(site.asked) == 1
    assert not part.file.exists()


def test_fewer_bytes_than_stated_are_no_file(site: Site, part: PartialFile) -> None:
    site.claim, site.ranges = len(CONTENT) + 10, False
    with pytest.raises(CommandError, match="gave up"):
        get(site.url, part)
    assert not part.whole


@pytest.mark.parametrize(
    ("headers", "reason"),
    [
        ({"Content-Type": "text/html; charset=utf-8"}, "web page"),
        ({"Content-Encoding": "gzip"}, "compressed"),
        ({"Content-Length": ""}, "no length"),
    ],
)
def test_a_response_that_is_not_the_file_is_refused(
    site: Site, part: PartialFile, headers: dict[str, str], reason: str
) -> None:
    site.headers = headers
    with pytest.raises(CommandError, match=reason):
        get(site.url, part)
    assert not part.whole


def test_without_a_network_the_message_names_the_host_and_what_to_do(part: PartialFile) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # bound and not listening: refuses
        with pytest.raises(CommandError, match=r"cannot reach 127\.0\.0\.1 .*online.*mirror"):
            get(f"http://127.0.0.1:{closed.getsockname()[1]}", part)


def test_an_unknown_host_is_named(part: PartialFile) -> None:
    with pytest.raises(CommandError, match=r"cannot reach nowhere\.invalid "):
        get("http://nowhere.invalid", part)
