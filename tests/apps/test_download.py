"""Truth: the bytes that a loopback server holds, and its own count of what it sent."""

import hashlib
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from apps.download import MissingError, Patience, download
from apps.failure import CommandError
from apps.part import Part
from tests.apps.site import Site, serving

CONTENT = b"".join(hashlib.sha256(bytes([i])).digest() for i in range(256)) * 64  # 512 KiB
PATIENCE = Patience(attempts=3, first_wait=0.0, timeout=5.0)


@pytest.fixture
def site() -> Iterator[Site]:
    with serving(Site(files={"/a.zip": CONTENT})) as site:
        yield site


@pytest.fixture
def part(tmp_path: Path) -> Part:
    return Part(tmp_path / "a.zip")


def get(url: str, part: Part) -> None:
    with httpx.Client(trust_env=False, follow_redirects=True, timeout=5.0) as client:
        download(client, f"{url}/a.zip", part, PATIENCE, lambda done, total: None)


def stop_after(site: Site, part: Part, n_bytes: int) -> None:
    """Leave a part of about ``n_bytes`` behind, as a run that is killed would."""

    def killed(done: int, total: int | None) -> None:
        if done >= n_bytes:
            raise KeyboardInterrupt

    with httpx.Client(trust_env=False, timeout=5.0) as client, pytest.raises(KeyboardInterrupt):
        download(client, f"{site.url}/a.zip", part, PATIENCE, killed)
    assert 0 < part.size < len(CONTENT)


def test_a_file_comes_whole(site: Site, part: Part) -> None:
    get(site.url, part)
    assert part.whole
    assert part.file.read_bytes() == CONTENT


def test_progress_ends_at_the_length_the_server_stated(site: Site, part: Part) -> None:
    seen: list[tuple[int, int | None]] = []
    with httpx.Client(trust_env=False) as client:
        url = f"{site.url}/a.zip"
        download(client, url, part, PATIENCE, lambda done, total: seen.append((done, total)))
    assert seen[-1] == (len(CONTENT), len(CONTENT))
    assert seen == sorted(seen)


def test_a_cut_connection_is_taken_up_where_it_broke(site: Site, part: Part) -> None:
    site.cuts = [100_000, 200_000]
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert [wanted for _, wanted in site.asked] == [None, "bytes=100000-", "bytes=300000-"]
    assert site.sent == len(CONTENT)


def test_any_number_of_cuts_is_borne_while_the_file_grows(site: Site, part: Part) -> None:
    site.cuts = [50_000] * 9  # more than PATIENCE bears without progress
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.sent == len(CONTENT)


def test_cuts_that_bring_nothing_are_given_up(site: Site, part: Part) -> None:
    site.cuts = [50_000, 0, 0, 0, 0, 0]
    with pytest.raises(CommandError, match="gave up"):
        get(site.url, part)
    assert part.size == 50_000


def test_a_rest_sent_in_pieces_is_asked_for_until_whole(site: Site, part: Part) -> None:
    stop_after(site, part, 100_000)
    site.at_most = 150_000
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


def test_another_stretch_than_asked_for_is_not_joined(site: Site, part: Part) -> None:
    stop_after(site, part, 100_000)
    site.shift = 10
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


def test_a_killed_run_leaves_no_file_that_looks_complete(
    site: Site, part: Part, tmp_path: Path
) -> None:
    stop_after(site, part, 100_000)
    assert not part.whole
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.zip.part", "a.zip.part.json"]


def test_the_run_after_a_killed_one_asks_for_the_rest_only(site: Site, part: Part) -> None:
    stop_after(site, part, 100_000)
    kept, site.sent = part.size, 0
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.asked[-1][1] == f"bytes={kept}-"
    assert site.sent == len(CONTENT) - kept


def test_a_whole_part_is_not_asked_for_again(site: Site, part: Part) -> None:
    get(site.url, part)
    site.asked.clear()
    get(site.url, part)
    assert site.asked == []


@pytest.mark.parametrize("marks", [{"ETag": '"two"'}, {"Last-Modified": "then"}, {"ETag": ""}])
@pytest.mark.parametrize("honest", [True, False])
def test_a_file_that_changed_meanwhile_starts_again(
    site: Site, part: Part, marks: dict[str, str], honest: bool
) -> None:
    stop_after(site, part, 100_000)
    site.files["/a.zip"] = CONTENT[::-1]
    site.marks, site.honest = marks, honest
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT[::-1]


def test_a_file_that_grew_under_the_same_mark_starts_again(site: Site, part: Part) -> None:
    stop_after(site, part, 100_000)
    site.files["/a.zip"] = CONTENT[::-1] + b"more"
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT[::-1] + b"more"


@pytest.mark.parametrize("mark", [{"ETag": 'W/"one"'}, {"ETag": ""}])
def test_bytes_of_an_unmarked_version_are_not_built_upon(
    site: Site, part: Part, mark: dict[str, str]
) -> None:
    site.marks = mark
    stop_after(site, part, 100_000)
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.asked[-1][1] is None


def test_a_date_serves_where_the_tag_is_weak(site: Site, part: Part) -> None:
    site.marks = {"ETag": 'W/"one"', "Last-Modified": "Sat, 21 Nov 2015 00:00:00 GMT"}
    stop_after(site, part, 100_000)
    kept = part.size
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.asked[-1][1] == f"bytes={kept}-"


def test_a_server_without_ranges_sends_all_again(site: Site, part: Part) -> None:
    site.ranges, site.cuts = False, [100_000]
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.sent == 100_000 + len(CONTENT)


@pytest.mark.parametrize("damage", [b"", b"{", b'{"validator": 1, "size": 2}'])
def test_a_part_without_a_readable_note_starts_again(
    site: Site, part: Part, tmp_path: Path, damage: bytes
) -> None:
    part.file.write_bytes(b"x" * 1000)
    (tmp_path / "a.zip.part.json").write_bytes(damage)
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


def test_a_part_longer_than_the_file_starts_again(site: Site, part: Part) -> None:
    stop_after(site, part, 100_000)
    part.file.write_bytes(CONTENT + b"more")
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


@pytest.mark.parametrize("faults", [[500], [503, 429], [416]])
def test_a_fault_that_passes_is_borne(site: Site, part: Part, faults: list[int]) -> None:
    stop_after(site, part, 100_000)
    site.faults = list(faults)
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


def test_a_server_that_keeps_failing_is_given_up(site: Site, part: Part) -> None:
    site.faults = [500] * 9
    with pytest.raises(CommandError, match=r"gave up .*HTTP 500.*run the same command again"):
        get(site.url, part)
    assert len(site.asked) == PATIENCE.attempts


def test_waits_double_from_one_failure_to_the_next(
    site: Site, part: Part, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []
    monkeypatch.setattr("apps.download.time.sleep", waits.append)
    site.faults = [500] * 3
    patience = Patience(attempts=9, first_wait=0.5, timeout=5.0)
    with httpx.Client(trust_env=False) as client:
        download(client, f"{site.url}/a.zip", part, patience, lambda done, total: None)
    assert waits == [0.5, 1.0, 2.0]


def test_a_missing_file_is_named_at_once(site: Site, part: Part) -> None:
    del site.files["/a.zip"]
    with pytest.raises(MissingError, match=r"a\.zip: not on the server \(HTTP 404\)"):
        get(site.url, part)
    assert len(site.asked) == 1
    assert not part.file.exists()


def test_fewer_bytes_than_stated_are_no_file(site: Site, part: Part) -> None:
    site.claim, site.ranges = len(CONTENT) + 10, False
    with pytest.raises(CommandError, match="gave up"):
        get(site.url, part)
    assert not part.whole


@pytest.mark.parametrize(
    ("headers", "reason"),
    [
        ({"Content-Type": "text/html; charset=utf-8"}, "web page"),
        ({"Content-Encoding": "gzip"}, "packed"),
        ({"Content-Length": ""}, "no length"),
    ],
)
def test_an_answer_that_is_not_the_file_is_refused(
    site: Site, part: Part, headers: dict[str, str], reason: str
) -> None:
    site.headers = headers
    with pytest.raises(CommandError, match=reason):
        get(site.url, part)
    assert not part.whole


def test_without_a_network_the_message_names_the_host_and_what_to_do(part: Part) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # bound and not listening: refuses
        with pytest.raises(CommandError, match=r"cannot reach 127\.0\.0\.1 .*online.*mirror"):
            get(f"http://127.0.0.1:{closed.getsockname()[1]}", part)


def test_an_unknown_host_is_named(part: Part) -> None:
    with pytest.raises(CommandError, match=r"cannot reach nowhere\.invalid "):
        get("http://nowhere.invalid", part)
