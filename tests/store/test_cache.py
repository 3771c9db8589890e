"""What is trusted: what was written; files that the test damaged."""

import logging
from math import inf, isnan, nan
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.store.cache import Cache, CacheEntry, code_hash, short_hash


def entry(number: int) -> CacheEntry:
    random = np.random.default_rng(number)
    arrays = {
        "motions": random.normal(size=(2, 5, 6, 3)).astype(np.float32),
        "bytes": np.frombuffer(b"some bytes", np.uint8),
    }
    return CacheEntry({"near_distance_error": float(random.uniform()), "worst": inf}, arrays)


def test_an_entry_is_read_as_it_was_written(tmp_path: Path) -> None:
    Cache(tmp_path, "code").put("source/body", entry(0))
    found, wanted = Cache(tmp_path, "code").get("source/body"), entry(0)
    assert found is not None and found.metadata == wanted.metadata
    assert {n: (a.dtype, a.shape, a.tobytes()) for n, a in found.arrays.items()} == {
        n: (a.dtype, a.shape, a.tobytes()) for n, a in wanted.arrays.items()
    }
    assert Cache(tmp_path, "code").get("source/other") is None
    assert Cache(tmp_path, "other").get("source/body") is None


def test_an_entry_may_have_no_arrays_and_metadata_that_are_no_number(tmp_path: Path) -> None:
    Cache(tmp_path, "code").put("key", CacheEntry({"odd": nan}, {}))
    found = Cache(tmp_path, "code").get("key")
    assert found is not None and found.arrays == {} and isnan(found.metadata["odd"])


@pytest.mark.parametrize("damage", ["array", "metadata", "name", "cut", "empty", "other"])
def test_a_damaged_entry_is_reported_and_deleted(
    tmp_path: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    cache = Cache(tmp_path, "code")
    cache.put("key", entry(0))
    cache.put("intact", entry(1))
    path = cache.path("key")
    data = path.read_bytes()
    contents = {
        "array": data.replace(b"some", b"sume"),
        "metadata": data.replace(b"near_distance_error", b"fear_error"),
        "name": data.replace(b'"motions"', b'"mations"'),
        "cut": data[:-9],
        "empty": b"",
        "other": b"{}" * 50,
    }
    assert contents[damage] != data
    path.write_bytes(contents[damage])
    with caplog.at_level(logging.WARNING):
        assert Cache(tmp_path, "code").get("key") is None
    assert f"{path} is damaged and will be computed again" in caplog.text
    assert not path.exists()
    assert cache.get("intact") is not None


def test_unused_entries_are_removed(tmp_path: Path) -> None:
    first = Cache(tmp_path, "code")
    for key in ("a", "b", "c/d"):
        first.put(key, entry(0))
    second = Cache(tmp_path, "code")
    second.get("b")
    second.put("e", entry(1))
    second.remove_unused()
    assert {path.stem for path in tmp_path.rglob("*.safetensors")} == {"b", "e"}


def test_other_namespaces_are_removed_and_nothing_else(tmp_path: Path) -> None:
    old, new = Cache(tmp_path, "old"), Cache(tmp_path, "new")
    old.put("key", entry(0))
    new.put("key", entry(0))
    (tmp_path / "note.txt").write_text("not of the cache")
    new.remove_other_namespaces()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "note.txt"]
    assert new.get("key") is not None
    Cache(tmp_path / "none", "new").remove_other_namespaces()


def test_no_temporary_file_is_left(tmp_path: Path) -> None:
    Cache(tmp_path, "code").put("key", entry(0))
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["key.safetensors"]


def test_the_code_hash_covers_files_and_versions() -> None:
    hashes = {
        code_hash(("data/*.py",), ("numpy",)),
        code_hash(("data/skeleton.py",), ("numpy",)),
        code_hash(("data/*.py",), ("scipy",)),
    }
    assert len(hashes) == 3
    with pytest.raises(ValueError, match="wanted files that match nowhere/"):
        code_hash(("nowhere/*.py",), ())


def test_keys_differ_where_parts_are_divided_otherwise() -> None:
    keys = {short_hash("ab", "c"), short_hash("a", "bc"), short_hash("abc"), short_hash(b"abc", "")}
    assert len(keys) == 4
