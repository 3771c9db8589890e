"""Truth: what was kept; a file that was spoilt by hand."""

import logging
from math import inf
from pathlib import Path

import pytest

from pacmo_core.store.finished import Finished, FinishedClip
from pacmo_core.store.variations import VariationFacts

BODY = {"trunk": 1.0, "left_forearm": 0.1 + 0.2}
ROW = VariationFacts("one~x", "one", "single", True, "", 0.3, {"rung": 1.0}, BODY, BODY)
REFUSED = VariationFacts("one~y", "one", "random", False, "refused: flat", inf, {}, BODY, BODY)
CLIP = FinishedClip([ROW, REFUSED], {"motions": b"some bytes", "sources": b"\0\1"})


def test_a_clip_is_given_as_it_was_kept(tmp_path: Path) -> None:
    Finished(tmp_path).keep("key", CLIP)
    assert Finished(tmp_path).get("key") == CLIP
    assert Finished(tmp_path).get("other") is None


def test_its_files_are_placed_under_the_clips_name(tmp_path: Path) -> None:
    CLIP.place(tmp_path, "s01/02")
    found = {str(p.relative_to(tmp_path)): p.read_bytes() for p in tmp_path.rglob("*.parquet")}
    assert found == {
        "motions/s01%2F02.parquet": b"some bytes",
        "sources/s01%2F02.parquet": b"\0\1",
    }
    assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == len(found)


@pytest.mark.parametrize("spoil", ["bit", "name", "cut", "empty", "other"])
def test_a_damaged_clip_is_told_and_removed(
    tmp_path: Path, spoil: str, caplog: pytest.LogCaptureFixture
) -> None:
    Finished(tmp_path).keep("key", CLIP)
    path = tmp_path / "key.safetensors"
    data = path.read_bytes()
    texts = {
        "bit": data.replace(b"some", b"sume"),
        "name": data.replace(b'"motions"', b'"mations"'),
        "cut": data[:-1],
        "empty": b"",
        "other": b"{}" * 50,
    }
    assert texts[spoil] != data
    path.write_bytes(texts[spoil])
    with caplog.at_level(logging.WARNING):
        assert Finished(tmp_path).get("key") is None
    assert f"{path} is damaged and will be made again" in caplog.text
    assert not path.exists()


def test_what_was_neither_given_nor_kept_is_forgotten(tmp_path: Path) -> None:
    first = Finished(tmp_path)
    for key in ("a", "b", "c"):
        first.keep(key, CLIP)
    second = Finished(tmp_path)
    second.get("b")
    second.keep("d", CLIP)
    second.forget_others()
    assert {path.stem for path in tmp_path.iterdir()} == {"b", "d"}
