"""Truth: archives that the test writes, good and bad ones, served from the loopback address."""

import io
import zipfile
from pathlib import Path

import pytest

from tests.commands.fetching import (
    GOOD_ZIP,
    PLACE_1,
    PLACE_2,
    TAKE_1,
    TAKE_2,
    files_below,
    sbu,
    zipped,
)
from tests.commands.site import Site


@pytest.mark.parametrize("above", ["", "s01s02/", "SBU/clean/s01s02/", "s01s02/s01s02/"])
def test_folders_above_the_action_do_not_matter(server: Site, tmp_path: Path, above: str) -> None:
    server.files["/s01s02.zip"] = zipped(
        {
            f"{above}01/001/skeleton_pos.txt": TAKE_1,
            f"{above}08/002/skeleton_pos.txt": TAKE_2,
            "__MACOSX/s01s02/01/001/skeleton_pos.txt": b"",
        }
    )
    assert sbu(server, tmp_path).exit_code == 0
    assert files_below(tmp_path / "sbu") == ["s01s02/01/001/skeleton_pos.txt", PLACE_2[4:]]


def test_one_bad_take_does_not_hide_the_good_one(server: Site, tmp_path: Path) -> None:
    server.files["/s01s02.zip"] = zipped(
        {"s01s02/01/001/skeleton_pos.txt": b"bad", "s01s02/08/002/skeleton_pos.txt": TAKE_2}
    )
    result = sbu(server, tmp_path)
    assert result.exit_code == 1
    assert PLACE_1 in result.stderr
    assert files_below(tmp_path) == ["SHA256SUMS", f"{PLACE_1}.aside", PLACE_2]


def test_an_archive_that_lacks_a_known_take_is_reported(server: Site, tmp_path: Path) -> None:
    server.files["/s01s02.zip"] = zipped({"s01s02/01/001/skeleton_pos.txt": TAKE_1})
    result = sbu(server, tmp_path)
    assert result.exit_code == 1
    assert f"1 files are missing, first {PLACE_2}" in result.stderr


@pytest.mark.parametrize(
    "name",
    [
        "../../escaped/01/001/skeleton_pos.txt",
        "/tmp/escaped/01/001/skeleton_pos.txt",
        "s01s02\\..\\..\\01/001/skeleton_pos.txt",
        "C:/01/001/skeleton_pos.txt",
        "../picture.png",
    ],
)
def test_an_archive_that_reaches_out_of_its_folder_is_refused_whole(
    server: Site, tmp_path: Path, name: str
) -> None:
    server.files["/s01s02.zip"] = zipped({"s01s02/08/002/skeleton_pos.txt": TAKE_2, name: TAKE_1})
    result = sbu(server, tmp_path / "dest")
    assert result.exit_code == 1
    assert "leads out of the folder" in result.stderr
    assert files_below(tmp_path) == []


def test_a_link_in_an_archive_is_refused(server: Site, tmp_path: Path) -> None:
    link = zipfile.ZipInfo("s01s02/01/001/skeleton_pos.txt")
    link.external_attr = 0o120777 << 16
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(link, "/etc/passwd")
    server.files["/s01s02.zip"] = stream.getvalue()
    result = sbu(server, tmp_path)
    assert result.exit_code == 1
    assert "leads out of the folder" in result.stderr


TWICE = {f"{above}/01/001/skeleton_pos.txt": TAKE_1 for above in ("a", "b")}
HUGE = {"s01s02/01/001/skeleton_pos.txt": b"0" * (9 << 20)}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"no archive", "not a complete zip"),
        (GOOD_ZIP[:-30], "not a complete zip"),
        (GOOD_ZIP[:60] + b"~~~~" + GOOD_ZIP[64:], "not a complete zip"),
        (zipped({"a": b""}), "holds no skeleton_pos.txt"),
        (zipped(TWICE), "holds 01/001/skeleton_pos.txt twice"),
        (zipped(HUGE), "s01s02/01/001/skeleton_pos.txt claims 9437184 bytes"),
    ],
)
def test_a_broken_archive_is_reported_and_not_kept(
    server: Site, tmp_path: Path, content: bytes, reason: str
) -> None:
    server.files["/s01s02.zip"] = content
    result = sbu(server, tmp_path)
    assert result.exit_code == 1
    assert f"s01s02.zip: {reason}" in result.stderr
    assert not [name for name in files_below(tmp_path) if "zip" in name]
    server.files["/s01s02.zip"] = GOOD_ZIP
    assert sbu(server, tmp_path).exit_code == 0


def test_a_cut_archive_is_resumed_by_the_next_run(server: Site, tmp_path: Path) -> None:
    server.cuts = [100_000, 0, 0]
    assert sbu(server, tmp_path).exit_code == 1
    assert files_below(tmp_path) == ["sbu/s01s02.zip.part", "sbu/s01s02.zip.part.json"]
    assert sbu(server, tmp_path).exit_code == 0
    assert server.sent == len(GOOD_ZIP) - 100_000
