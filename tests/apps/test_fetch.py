"""Truth: the bytes that a loopback server holds, and SHA-256 as the standard library has it."""

import hashlib
import io
import json
import os
import random
import re
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

import apps.cli_fetch
from apps.checksums import Sums, shipped
from apps.cli import app
from apps.download import Patience
from apps.sources import CMU, SBU
from tests.apps.site import Site, serving

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


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    """Serve pair s01s02 and subject 33 of known content; no other sum is known."""
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    patience = Patience(attempts=2, first_wait=0.0, timeout=5.0)
    monkeypatch.setattr(apps.cli_fetch, "PATIENCE", patience)
    know(monkeypatch, {PLACE_1: sha256(TAKE_1), PLACE_2: sha256(TAKE_2)})
    files = {"/s01s02.zip": GOOD_ZIP}
    files |= {f"/33/{name}": name.encode() for name in ("33.asf", "33_01.amc", "33_02.amc")}
    with serving(Site(files=files)) as site:
        yield site


def know(monkeypatch: pytest.MonkeyPatch, sums: dict[str, str]) -> None:
    monkeypatch.setattr(apps.cli_fetch, "shipped", lambda: sums)


def pacmo(site: Site, what: str, dest: Path, part: str, *more: str) -> Result:
    site.asked.clear()
    site.sent = 0
    words = ["fetch", what, str(dest), "--base-url", site.url, "--only", part, *more]
    return CliRunner().invoke(app, words)


def sbu(site: Site, dest: Path, *more: str) -> Result:
    return pacmo(site, "sbu", dest, "s01s02", *more)


def cmu(site: Site, dest: Path, *more: str) -> Result:
    return pacmo(site, "cmu-two-person", dest, "33", *more)


def files_below(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_sbu_keeps_the_skeletons_alone(site: Site, tmp_path: Path) -> None:
    result = sbu(site, tmp_path)
    assert result.exit_code == 0, result.output
    assert files_below(tmp_path) == ["SHA256SUMS", PLACE_1, PLACE_2]
    assert (tmp_path / PLACE_2).read_bytes() == TAKE_2


@pytest.mark.parametrize("above", ["", "s01s02/", "SBU/clean/s01s02/", "s01s02/s01s02/"])
def test_folders_above_the_action_do_not_matter(site: Site, tmp_path: Path, above: str) -> None:
    site.files["/s01s02.zip"] = zipped(
        {
            f"{above}01/001/skeleton_pos.txt": TAKE_1,
            f"{above}08/002/skeleton_pos.txt": TAKE_2,
            "__MACOSX/s01s02/01/001/skeleton_pos.txt": b"",
        }
    )
    assert sbu(site, tmp_path).exit_code == 0
    assert files_below(tmp_path / "sbu") == ["s01s02/01/001/skeleton_pos.txt", PLACE_2[4:]]


def test_cmu_files_stand_by_subject(site: Site, tmp_path: Path) -> None:
    assert cmu(site, tmp_path).exit_code == 0
    assert files_below(tmp_path / "cmu_two_person") == ["33/33.asf", "33/33_01.amc", "33/33_02.amc"]


@pytest.mark.parametrize("get", [sbu, cmu])
def test_a_second_run_asks_for_nothing(
    site: Site, tmp_path: Path, get: Callable[[Site, Path], Result]
) -> None:
    first = get(site, tmp_path)
    assert first.exit_code == 0
    before = {name: (tmp_path / name).stat().st_mtime_ns for name in files_below(tmp_path)}
    again = get(site, tmp_path)
    assert (again.exit_code, site.asked, site.sent) == (0, [], 0)
    assert before == {n: (tmp_path / n).stat().st_mtime_ns for n in files_below(tmp_path)}


def test_sums_are_written_as_sha256sum_reads_them(site: Site, tmp_path: Path) -> None:
    cmu(site, tmp_path)
    lines = (tmp_path / "SHA256SUMS").read_text().splitlines()
    assert lines[0] == f"{sha256(b'33.asf')}  cmu_two_person/33/33.asf"
    assert len(lines) == 3


def test_a_file_damaged_here_is_fetched_anew(site: Site, tmp_path: Path) -> None:
    cmu(site, tmp_path)
    damaged = tmp_path / "cmu_two_person/33/33_01.amc"
    damaged.write_bytes(b"damaged")
    result = cmu(site, tmp_path)
    assert result.exit_code == 0
    assert damaged.read_bytes() == b"33_01.amc"
    assert damaged.with_name("33_01.amc.aside").read_bytes() == b"damaged"
    assert [path for path, _ in site.asked] == ["/33/33_01.amc"]


def test_a_file_that_belies_its_shipped_sum_is_not_left_as_good(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = "cmu_two_person/33/33_01.amc"
    know(monkeypatch, {place: sha256(b"right")})
    result = cmu(site, tmp_path)
    assert result.exit_code == 1
    for words in (place, f"wanted SHA-256 {sha256(b'right')}", f"got {sha256(b'33_01.amc')}"):
        assert words in result.stderr
    assert not (tmp_path / place).exists()
    assert (tmp_path / f"{place}.aside").exists()
    assert (tmp_path / "cmu_two_person/33/33_02.amc").exists()  # the rest came all the same
    assert place not in (tmp_path / "SHA256SUMS").read_text()


def test_a_file_that_belies_its_recorded_sum_is_not_left_as_good(
    site: Site, tmp_path: Path
) -> None:
    cmu(site, tmp_path)
    asf = tmp_path / "cmu_two_person/33/33.asf"
    asf.unlink()
    site.files["/33/33.asf"] = b"another"
    result = cmu(site, tmp_path)
    assert result.exit_code == 1
    assert f"wanted SHA-256 {sha256(b'33.asf')}, got {sha256(b'another')}" in result.stderr
    assert not asf.exists()


def test_a_changed_file_can_be_accepted_for_good(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    know(monkeypatch, {"cmu_two_person/33/33.asf": sha256(b"right")})
    assert cmu(site, tmp_path, "--accept-changed").exit_code == 0
    assert cmu(site, tmp_path).exit_code == 0
    assert site.asked == []


def test_one_bad_take_does_not_hide_the_good_one(site: Site, tmp_path: Path) -> None:
    site.files["/s01s02.zip"] = zipped(
        {"s01s02/01/001/skeleton_pos.txt": b"bad", "s01s02/08/002/skeleton_pos.txt": TAKE_2}
    )
    result = sbu(site, tmp_path)
    assert result.exit_code == 1
    assert PLACE_1 in result.stderr
    assert files_below(tmp_path) == ["SHA256SUMS", f"{PLACE_1}.aside", PLACE_2]


def test_an_archive_that_lacks_a_known_take_is_reported(site: Site, tmp_path: Path) -> None:
    site.files["/s01s02.zip"] = zipped({"s01s02/01/001/skeleton_pos.txt": TAKE_1})
    result = sbu(site, tmp_path)
    assert result.exit_code == 1
    assert f"lacks 1 files, first {PLACE_2}" in result.stderr


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
    site: Site, tmp_path: Path, name: str
) -> None:
    site.files["/s01s02.zip"] = zipped({"s01s02/08/002/skeleton_pos.txt": TAKE_2, name: TAKE_1})
    result = sbu(site, tmp_path / "dest")
    assert result.exit_code == 1
    assert "leads out of the folder" in result.stderr
    assert files_below(tmp_path) == []


def test_a_link_in_an_archive_is_refused(site: Site, tmp_path: Path) -> None:
    link = zipfile.ZipInfo("s01s02/01/001/skeleton_pos.txt")
    link.external_attr = 0o120777 << 16
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(link, "/etc/passwd")
    site.files["/s01s02.zip"] = stream.getvalue()
    result = sbu(site, tmp_path)
    assert result.exit_code == 1
    assert "leads out of the folder" in result.stderr


TWICE = {f"{above}/01/001/skeleton_pos.txt": TAKE_1 for above in ("a", "b")}
HUGE = {"s01s02/01/001/skeleton_pos.txt": b"0" * (9 << 20)}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"no archive", "not a whole zip"),
        (GOOD_ZIP[:-30], "not a whole zip"),
        (GOOD_ZIP[:60] + b"~~~~" + GOOD_ZIP[64:], "not a whole zip"),
        (zipped({"a": b""}), "holds no skeleton_pos.txt"),
        (zipped(TWICE), "holds 01/001/skeleton_pos.txt twice"),
        (zipped(HUGE), "s01s02/01/001/skeleton_pos.txt claims 9437184 bytes"),
    ],
)
def test_a_broken_archive_is_reported_and_not_kept(
    site: Site, tmp_path: Path, content: bytes, reason: str
) -> None:
    site.files["/s01s02.zip"] = content
    result = sbu(site, tmp_path)
    assert result.exit_code == 1
    assert f"s01s02.zip: {reason}" in result.stderr
    assert not [name for name in files_below(tmp_path) if "zip" in name]
    site.files["/s01s02.zip"] = GOOD_ZIP
    assert sbu(site, tmp_path).exit_code == 0


def test_a_cut_archive_is_resumed_by_the_next_run(site: Site, tmp_path: Path) -> None:
    site.cuts = [100_000, 0, 0]
    assert sbu(site, tmp_path).exit_code == 1
    assert files_below(tmp_path) == ["sbu/s01s02.zip.part", "sbu/s01s02.zip.part.json"]
    assert sbu(site, tmp_path).exit_code == 0
    assert site.sent == len(GOOD_ZIP) - 100_000


def test_a_file_missing_on_the_server_does_not_stop_the_rest(site: Site, tmp_path: Path) -> None:
    del site.files["/33/33_01.amc"]
    result = cmu(site, tmp_path)
    assert result.exit_code == 1
    assert "33_01.amc: not on the server" in result.stderr
    assert files_below(tmp_path / "cmu_two_person") == ["33/33.asf", "33/33_02.amc"]


def test_a_spoilt_sums_file_is_named_with_its_line(site: Site, tmp_path: Path) -> None:
    (tmp_path / "SHA256SUMS").write_text("what is this\n")
    result = cmu(site, tmp_path)
    assert result.exit_code == 1
    assert "SHA256SUMS:1: wanted" in result.stderr


def test_every_shipped_sum_is_a_sum_of_a_file_that_can_be_fetched() -> None:
    folders = {f"{s.folder}/{part}" for s in (SBU, CMU) for part in s.parts}
    for place, wanted in shipped().items():
        assert re.fullmatch(r"[0-9a-f]{64}", wanted)
        assert "/".join(place.split("/")[:2]) in folders
    known_pairs = {place.split("/")[1] for place in shipped() if place.startswith("sbu/")}
    assert known_pairs == set(SBU.parts)


def test_cmu_lists_both_people_of_every_trial() -> None:
    files = [file for part in CMU.parts for file in CMU.files(part)]
    assert len(files) == len(set(files)) == 10 + 2 * 70
    for a, b in zip(CMU.parts[::2], CMU.parts[1::2], strict=True):
        assert [f.replace(f"{a}/{a}", f"{b}/{b}") for f in CMU.files(a)] == CMU.files(b)


def test_the_real_skeletons_have_the_shipped_sums() -> None:
    root = Path(os.environ.get("PACMO_REAL_DATA", "../shared/data"))
    if not (root / "sbu").is_dir():
        pytest.skip(f"no real captures in {root}; PACMO_REAL_DATA may name another folder")
    sums = Sums(root, shipped())
    places = [place for place in sums.places("sbu") if (root / place).exists()]
    assert len(places) == 282
    assert all(sums.verified(place) for place in places)


def test_shipped_sums_say_where_they_come_from() -> None:
    text = (Path(apps.cli_fetch.__file__).parent / "known_sums.json").read_text()
    assert "public copy" in json.loads(text)["about"]
