"""Truth: the bytes that a loopback server holds, and its own count of what it sent."""

from pathlib import Path

import httpx
import pytest

from pacmo_core.commands.download import PartialFile, download
from pacmo_core.project.workspace import CommandError
from tests.commands.downloading import CONTENT, PATIENCE, get, stop_after
from tests.commands.site import Site


def test_a_file_comes_whole(site: Site, part: PartialFile) -> None:
    get(site.url, part)
    assert part.whole
    assert part.file.read_bytes() == CONTENT


def test_progress_ends_at_the_length_the_server_stated(site: Site, part: PartialFile) -> None:
    seen: list[tuple[int, int | None]] = []
    with httpx.Client(trust_env=False) as client:
        url = f"{site.url}/a.zip"
        download(client, url, part, PATIENCE, lambda done, total: seen.append((done, total)))
    assert seen[-1] == (len(CONTENT), len(CONTENT))
    assert seen == sorted(seen)


def test_a_cut_connection_is_taken_up_where_it_broke(site: Site, part: PartialFile) -> None:
    site.cuts = [100_000, 200_000]
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert [wanted for _, wanted in site.asked] == [None, "bytes=100000-", "bytes=300000-"]
    assert site.sent == len(CONTENT)


def test_any_number_of_cuts_is_borne_while_the_file_grows(site: Site, part: PartialFile) -> None:
    site.cuts = [50_000] * 9  # more than PATIENCE bears without progress
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.sent == len(CONTENT)


def test_cuts_that_bring_nothing_are_given_up(site: Site, part: PartialFile) -> None:
    site.cuts = [50_000, 0, 0, 0, 0, 0]
    with pytest.raises(CommandError, match="gave up"):
        get(site.url, part)
    assert part.size == 50_000


def test_a_rest_sent_in_pieces_is_asked_for_until_whole(site: Site, part: PartialFile) -> None:
    stop_after(site, part, 100_000)
    site.at_most = 150_000
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


def test_another_stretch_than_asked_for_is_not_joined(site: Site, part: PartialFile) -> None:
    stop_after(site, part, 100_000)
    site.shift = 10
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


def test_a_killed_run_leaves_no_file_that_looks_complete(
    site: Site, part: PartialFile, tmp_path: Path
) -> None:
    stop_after(site, part, 100_000)
    assert not part.whole
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.zip.part", "a.zip.part.json"]


def test_the_run_after_a_killed_one_asks_for_the_rest_only(site: Site, part: PartialFile) -> None:
    stop_after(site, part, 100_000)
    kept, site.sent = part.size, 0
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.asked[-1][1] == f"bytes={kept}-"
    assert site.sent == len(CONTENT) - kept


def test_a_whole_part_is_not_asked_for_again(site: Site, part: PartialFile) -> None:
    get(site.url, part)
    site.asked.clear()
    get(site.url, part)
    assert site.asked == []


@pytest.mark.parametrize("marks", [{"ETag": '"two"'}, {"Last-Modified": "then"}, {"ETag": ""}])
@pytest.mark.parametrize("honest", [True, False])
def test_a_file_that_changed_meanwhile_starts_again(
    site: Site, part: PartialFile, marks: dict[str, str], honest: bool
) -> None:
    stop_after(site, part, 100_000)
    site.files["/a.zip"] = CONTENT[::-1]
    site.marks, site.honest = marks, honest
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT[::-1]


def test_a_file_that_grew_under_the_same_mark_starts_again(site: Site, part: PartialFile) -> None:
    stop_after(site, part, 100_000)
    site.files["/a.zip"] = CONTENT[::-1] + b"more"
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT[::-1] + b"more"


@pytest.mark.parametrize("mark", [{"ETag": 'W/"one"'}, {"ETag": ""}])
def test_bytes_of_an_unmarked_version_are_not_built_upon(
    site: Site, part: PartialFile, mark: dict[str, str]
) -> None:
    site.marks = mark
    stop_after(site, part, 100_000)
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.asked[-1][1] is None


def test_a_date_serves_where_the_tag_is_weak(site: Site, part: PartialFile) -> None:
    site.marks = {"ETag": 'W/"one"', "Last-Modified": "Sat, 21 Nov 2015 00:00:00 GMT"}
    stop_after(site, part, 100_000)
    kept = part.size
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.asked[-1][1] == f"bytes={kept}-"


def test_a_server_without_ranges_sends_all_again(site: Site, part: PartialFile) -> None:
    site.ranges, site.cuts = False, [100_000]
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
    assert site.sent == 100_000 + len(CONTENT)


@pytest.mark.parametrize("damage", [b"", b"{", b'{"validator": 1, "size": 2}'])
def test_a_part_without_a_readable_note_starts_again(
    site: Site, part: PartialFile, tmp_path: Path, damage: bytes
) -> None:
    part.file.write_bytes(b"x" * 1000)
    (tmp_path / "a.zip.part.json").write_bytes(damage)
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT


def test_a_part_longer_than_the_file_starts_again(site: Site, part: PartialFile) -> None:
    stop_after(site, part, 100_000)
    part.file.write_bytes(CONTENT + b"more")
    get(site.url, part)
    assert part.file.read_bytes() == CONTENT
