"""Truth: the bytes that a loopback server holds, and SHA-256 as the standard library has it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from tests.commands.fetching import PLACE_1, PLACE_2, TAKE_2, cmu, files_below, know, sbu, sha256
from tests.commands.site import Site


def test_sbu_keeps_the_skeletons_alone(server: Site, tmp_path: Path) -> None:
    result = sbu(server, tmp_path)
    assert result.exit_code == 0, result.output
    assert files_below(tmp_path) == ["SHA256SUMS", PLACE_1, PLACE_2]
    assert (tmp_path / PLACE_2).read_bytes() == TAKE_2


def test_cmu_files_stand_by_subject(server: Site, tmp_path: Path) -> None:
    assert cmu(server, tmp_path).exit_code == 0
    assert files_below(tmp_path / "cmu_two_person") == ["33/33.asf", "33/33_01.amc", "33/33_02.amc"]


@pytest.mark.parametrize("get", [sbu, cmu])
def test_a_second_run_asks_for_nothing(
    server: Site, tmp_path: Path, get: Callable[[Site, Path], Result]
) -> None:
    first = get(server, tmp_path)
    assert first.exit_code == 0
    before = {name: (tmp_path / name).stat().st_mtime_ns for name in files_below(tmp_path)}
    again = get(server, tmp_path)
    assert (again.exit_code, server.asked, server.sent) == (0, [], 0)
    assert before == {n: (tmp_path / n).stat().st_mtime_ns for n in files_below(tmp_path)}


def test_sums_are_written_as_sha256sum_reads_them(server: Site, tmp_path: Path) -> None:
    cmu(server, tmp_path)
    lines = (tmp_path / "SHA256SUMS").read_text().splitlines()
    assert lines[0] == f"{sha256(b'33.asf')}  cmu_two_person/33/33.asf"
    assert len(lines) == 3


def test_a_file_damaged_here_is_fetched_anew(server: Site, tmp_path: Path) -> None:
    cmu(server, tmp_path)
    damaged = tmp_path / "cmu_two_person/33/33_01.amc"
    damaged.write_bytes(b"damaged")
    result = cmu(server, tmp_path)
    assert result.exit_code == 0
    assert damaged.read_bytes() == b"33_01.amc"
    assert damaged.with_name("33_01.amc.aside").read_bytes() == b"damaged"
    assert [path for path, _ in server.asked] == ["/33/33_01.amc"]


def test_a_file_that_belies_its_shipped_sum_is_not_left_as_good(
    server: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = "cmu_two_person/33/33_01.amc"
    know(monkeypatch, {place: sha256(b"right")})
    result = cmu(server, tmp_path)
    assert result.exit_code == 1
    for words in (place, f"wanted SHA-256 {sha256(b'right')}", f"got {sha256(b'33_01.amc')}"):
        assert words in result.stderr
    assert not (tmp_path / place).exists()
    assert (tmp_path / f"{place}.aside").exists()
    assert (tmp_path / "cmu_two_person/33/33_02.amc").exists()  # the rest came all the same
    assert place not in (tmp_path / "SHA256SUMS").read_text()


def test_a_file_that_belies_its_recorded_sum_is_not_left_as_good(
    server: Site, tmp_path: Path
) -> None:
    cmu(server, tmp_path)
    asf = tmp_path / "cmu_two_person/33/33.asf"
    asf.unlink()
    server.files["/33/33.asf"] = b"another"
    result = cmu(server, tmp_path)
    assert result.exit_code == 1
    assert f"wanted SHA-256 {sha256(b'33.asf')}, got {sha256(b'another')}" in result.stderr
    assert not asf.exists()


def test_a_changed_file_can_be_accepted_for_good(
    server: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    know(monkeypatch, {"cmu_two_person/33/33.asf": sha256(b"right")})
    assert cmu(server, tmp_path, "--accept-changed").exit_code == 0
    assert cmu(server, tmp_path).exit_code == 0
    assert server.asked == []


def test_a_file_missing_on_the_server_does_not_stop_the_rest(server: Site, tmp_path: Path) -> None:
    del server.files["/33/33_01.amc"]
    result = cmu(server, tmp_path)
    assert result.exit_code == 1
    assert "33_01.amc: not on the server" in result.stderr
    assert files_below(tmp_path / "cmu_two_person") == ["33/33.asf", "33/33_02.amc"]


def test_a_spoilt_sums_file_is_named_with_its_line(server: Site, tmp_path: Path) -> None:
    (tmp_path / "SHA256SUMS").write_text("what is this\n")
    result = cmu(server, tmp_path)
    assert result.exit_code == 1
    assert "SHA256SUMS:1: wanted" in result.stderr
