"""What is trusted: the bytes that the test wrote, and hashlib."""

import hashlib
from pathlib import Path

import pytest

from pacmo_core.store.files import atomic_file, file_hash, write_text


@pytest.mark.parametrize("sync", [True, False])
def test_a_file_appears_complete_under_its_name_alone(tmp_path: Path, sync: bool) -> None:
    path = tmp_path / "folder" / "file.txt"
    with atomic_file(path, sync=sync) as partial:
        partial.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    assert [path] == list(path.parent.iterdir())


def test_after_an_error_the_file_has_its_old_content(tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    write_text(path, "old ü")
    with pytest.raises(ValueError, match="half"), atomic_file(path) as partial:
        partial.write_text("ne")
        raise ValueError("half")
    assert path.read_text(encoding="utf-8") == "old ü"
    assert [path] == list(tmp_path.iterdir())


def test_the_hash_of_files_is_that_of_their_content_in_order(tmp_path: Path) -> None:
    one, two = tmp_path / "1", tmp_path / "2"
    one.write_bytes(b"a" * (1 << 21))
    two.write_bytes(b"b")
    assert file_hash(one, two) == hashlib.sha256(b"a" * (1 << 21) + b"b").hexdigest()
    assert file_hash(one, two) != file_hash(two, one)
