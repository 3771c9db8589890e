"""What is trusted: what ingestion gives with nothing kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core import ingestion
from pacmo_core.formats.registry import open_format
from pacmo_core.ingestion import ReadingCache, reading_key
from stages.ingest import main
from tests.test_ingestion import NTU, bodies, ingest, write

PARAMS = """\
ingest:
  dataset: test
  raw: raw
  format: ntu
  settings: {fps: 30.0, max_gap: 5, max_link_distance: 0.3, min_visible_share: 0.5}
  include: ["*"]
  drop_joints: [left_thumb]
  limits:
    min_frames: 10
    max_rate_jitter: 0.5
    max_rate_error: 0.02
    max_bone_length_variation: 0.2
    max_joint_speed: 25
    max_body_speed: 8
    min_person_distance: 0.1
  contact_distance: 0.1
  stated_fps:
"""


@pytest.fixture
def raw(tmp_path, monkeypatch):
    """Make three captures, one of them spoilt, and parameters that read them."""
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text(PARAMS)
    folder = Path("raw")
    folder.mkdir()
    for number in (1, 2, 3):
        write(folder, number, bodies(number))
    (folder / "S001C001P001R002A050.skeleton").write_text("20\nno bodies\n")
    return folder


@pytest.fixture
def reads(monkeypatch):
    """Count the sequences that are read rather than found."""
    read, real = [], ingestion.read_sequence

    def counted(recipe, sequence):
        read.append(sequence.name)
        return real(recipe, sequence)

    monkeypatch.setattr(ingestion, "read_sequence", counted)
    return read


def run(out: str, cache: Path | None = Path("cache")) -> dict[str, bytes]:
    main(Path("raw"), Path(out), Path(f"{out}.json"), cache=cache)
    files = [*sorted(Path(out).iterdir()), Path(f"{out}.json")]
    return {path.name.replace(out, ""): path.read_bytes() for path in files}


def test_with_what_is_kept_a_set_is_ingested_to_the_same_bytes(raw, reads):
    clean = run("clean", cache=None)
    assert run("first") == clean
    reads.clear()
    assert run("again") == clean
    assert reads == []


def test_one_more_capture_is_one_more_reading_and_the_bytes_of_a_clean_run(raw, reads):
    run("before")
    write(raw, 0, bodies(9))
    reads.clear()
    more = run("more")
    assert reads == ["S001C001P001R000A050"]
    assert more == run("clean", cache=None)


def test_a_changed_file_or_setting_is_read_anew(raw, reads):
    run("before")
    write(raw, 1, bodies(11))
    reads.clear()
    run("after")
    assert reads == ["S001C001P001R001A050"]
    Path("params.yaml").write_text(PARAMS.replace("contact_distance: 0.1", "contact_distance: 0.2"))
    reads.clear()
    assert run("settings") == run("clean", cache=None)
    assert len(reads) == 2 * 3


def test_an_edit_of_the_code_is_read_anew_too(raw, reads, monkeypatch):
    run("before")
    reads.clear()
    monkeypatch.setattr("pacmo_core.ingestion.reading_code_hash", lambda: "edited")
    run("after")
    assert len(reads) == 3


@pytest.mark.parametrize("spoil", ["cut", "turn a byte"])
def test_what_was_damaged_is_read_anew_to_the_same_bytes(raw, reads, spoil):
    clean = run("clean")
    file = min(Path("cache").rglob("*.safetensors"))
    data = bytearray(file.read_bytes())
    if spoil == "cut":
        file.write_bytes(data[: len(data) // 2])
    else:
        data[-5] ^= 0xFF
        file.write_bytes(data)
    reads.clear()
    assert run("again") == clean
    assert len(reads) == 1


def test_what_comes_back_is_what_was_kept(tmp_path):
    raw = tmp_path / "raw"
    raw.mkdir()
    write(raw, 1, bodies(1))
    (raw / "S001C001P001R002A050.skeleton").write_text("no bodies\n")
    good, bad = ingest(raw)
    cache = ReadingCache(tmp_path / "cache", "settings")
    cache.put("good", good[0])
    cache.put("bad", bad[0])
    cache = ReadingCache(tmp_path / "cache", "settings")
    assert cache.get("bad") == bad[0] and cache.get("none") is None
    record, interaction = cache.get("good")
    assert record == good[0][0] and interaction.skeleton == good[0][1].skeleton
    for name in ("times", "person_a", "person_b"):
        np.testing.assert_array_equal(getattr(interaction, name), getattr(good[0][1], name))
    assert ReadingCache(tmp_path / "cache", "other settings").get("good") is None


def test_a_sequences_key_holds_its_labels_its_place_and_its_content(tmp_path):
    write(tmp_path, 1, bodies(1))
    (sequence,) = open_format("ntu", NTU).find(tmp_path)
    keys = {
        reading_key(sequence, "a"),
        reading_key(sequence, "b"),
        reading_key(replace(sequence, action="other"), "a"),
        reading_key(replace(sequence, files=(tmp_path / "elsewhere",)), "a"),
    }
    assert len(keys) == 4
