"""What is trusted: rows and bytes that the test wrote."""

from math import inf
from pathlib import Path

import numpy as np

from pacmo_core.augmentation.clip_files import ClipFiles, variation_from_entry, variation_to_entry
from pacmo_core.augmentation.run import SolvedVariation
from pacmo_core.store.cache import Cache
from pacmo_core.store.tables import VariationRecord

BODY = {"trunk": 1.0, "left_forearm": 0.1 + 0.2}
ROW = VariationRecord("one~x", "one", "single", True, "", 0.3, {"attempt": 1.0}, BODY, BODY)
REFUSED = VariationRecord("one~y", "one", "random", False, "refused: flat", inf, {}, BODY, BODY)
CLIP = ClipFiles([ROW, REFUSED], {"motions": b"some bytes", "sources": b"\0\1"})


def test_a_clip_is_read_from_the_cache_as_it_was_written(tmp_path: Path) -> None:
    Cache(tmp_path, "settings").put("key", CLIP.to_entry())
    entry = Cache(tmp_path, "settings").get("key")
    assert entry is not None
    assert ClipFiles.from_entry(entry) == CLIP


def test_a_variation_is_read_from_the_cache_as_it_was_written(tmp_path: Path) -> None:
    motions = np.random.default_rng(0).normal(size=(2, 5, 6, 3)).astype(np.float32)
    solved = SolvedVariation(motions, {"near_distance_error": 0.1 + 0.2, "odd": float("nan")})
    Cache(tmp_path, "solver").put("source/body", variation_to_entry(solved))
    entry = Cache(tmp_path, "solver").get("source/body")
    assert entry is not None
    result = variation_from_entry(entry)
    assert result.motions.tobytes() == motions.tobytes()
    np.testing.assert_equal(result.measurements, solved.measurements)


def test_its_files_are_written_under_the_name_of_the_clip(tmp_path: Path) -> None:
    CLIP.write(tmp_path, "s01/02")
    result = {str(p.relative_to(tmp_path)): p.read_bytes() for p in tmp_path.rglob("*.parquet")}
    assert result == {
        "motions/s01%2F02.parquet": b"some bytes",
        "sources/s01%2F02.parquet": b"\0\1",
    }
    assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == len(result)
