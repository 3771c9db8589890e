"""Truth: what was written; a file that was spoilt by hand."""

import logging
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.augmentation.solve import Made
from pacmo_core.store.kept import Kept, read_kept


def made(number: int) -> Made:
    random = np.random.default_rng(number)
    motions = random.normal(size=(2, 5, 6, 3)).astype(np.float32)
    return Made(motions, {"near_error": float(random.uniform()), "rung": 1.0, "odd": float("nan")})


BATCH = {"b0": made(0), "b1": made(1)}


def test_what_was_kept_is_found_and_read_as_it_was(tmp_path: Path) -> None:
    kept = Kept(tmp_path, "maker")
    assert kept.find("source") == {}
    written = kept.write("source", BATCH) | kept.write("source", {"b2": made(2)})
    assert Kept(tmp_path, "maker").find("source") == written
    for name, wanted in (BATCH | {"b2": made(2)}).items():
        found = read_kept(written[name], name)
        assert found.motions.tobytes() == wanted.motions.tobytes()
        np.testing.assert_equal(found.figures, wanted.figures)
    assert kept.find("other") == Kept(tmp_path, "another").find("source") == {}


def test_an_empty_batch_leaves_no_file(tmp_path: Path) -> None:
    assert Kept(tmp_path, "maker").write("source", {}) == {}
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("spoil", ["bit", "cut", "empty", "other"])
def test_a_damaged_file_is_found_told_and_removed(
    tmp_path: Path, spoil: str, caplog: pytest.LogCaptureFixture
) -> None:
    kept = Kept(tmp_path, "maker")
    good = kept.write("source", {"b2": made(2)})
    path = kept.write("source", BATCH)["b0"]
    data = bytearray(path.read_bytes())
    data[-40] ^= 1
    texts = {"bit": bytes(data), "cut": data[:-9], "empty": b"", "other": b"{}" * 50}
    path.write_bytes(texts[spoil])
    with caplog.at_level(logging.WARNING):
        assert kept.find("source") == good
    assert str(path) in caplog.text
    assert "will be made again" in caplog.text
    assert not path.exists()


def test_what_other_code_made_is_forgotten_and_nothing_else(tmp_path: Path) -> None:
    old, new = Kept(tmp_path, "old"), Kept(tmp_path, "new")
    old.write("source", BATCH)
    written = new.write("source", BATCH)
    (tmp_path / "note.txt").write_text("mine")
    new.forget_others()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new", "note.txt"]
    assert new.find("source") == written
    Kept(tmp_path / "none", "new").forget_others()
