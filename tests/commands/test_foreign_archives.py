"""Truth: archives that ``benchmarks.robustness`` crafts, each with one fault."""

import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from benchmarks._crafted import TAKE, _write_archive
from pacmo_core.commands.download import ArchiveError, Checksums, extract_skeletons
from pacmo_core.project.workspace import CommandError

Write = Callable[[Path, Path], None]
write = _write_archive
FAULTS: dict[str, Write] = {
    "is encrypted": partial(write, (TAKE,), flag=1),
    "is packed by method 12": partial(write, (TAKE,), method=zipfile.ZIP_BZIP2),
    "is packed by method 14": partial(write, (TAKE,), method=zipfile.ZIP_LZMA),
    "not a complete zip archive": partial(write, (TAKE,), method=zipfile.ZIP_DEFLATED, size=10),
    "claims 1073741824 bytes": partial(write, (TAKE,), size=1 << 30),
    "can't decode": partial(write, (f"é/{TAKE}",), encoded=("é".encode(), b"\xff\xff")),
    "no skeleton_pos": partial(write, ("s01s02/٠١/٠٠١/skeleton_pos.txt",)),
}


@pytest.mark.parametrize("reason", FAULTS)
def test_an_archive_with_a_fault_is_refused(tmp_path: Path, reason: str) -> None:
    FAULTS[reason](tmp_path, tmp_path)
    with pytest.raises(ArchiveError, match=f"s01s02.zip.*{reason}"):
        list(extract_skeletons(tmp_path / "s01s02.zip"))


def test_a_good_archive_is_extracted(tmp_path: Path) -> None:
    write((TAKE,), tmp_path, tmp_path, method=zipfile.ZIP_DEFLATED)
    taken = dict(extract_skeletons(tmp_path / "s01s02.zip"))
    assert taken == {"01/001/skeleton_pos.txt": b"1,2,3\n" * 1000}


def test_checksums_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "SHA256SUMS").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(CommandError, match="SHA256SUMS:1: wanted"):
        Checksums(tmp_path, {})
