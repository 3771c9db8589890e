"""What is trusted: written and published files; for the cache what ingestion gives without it."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core import ingestion
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.formats.registry import (
    DEFAULT_SETTINGS,
    FORMAT_OF_SUFFIX,
    FORMATS,
    open_format,
)
from pacmo_core.formats.write_ntu import format_ntu
from pacmo_core.formats.write_tables import JointTable, npz_table
from pacmo_core.ingestion import IngestionSettings, ReadingCache, read_sequences, reading_key
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, read_rows, write_rows
from stages.common.params import StageError
from stages.ingest import main
from tests.flows.projects import capture
from tests.formats.real_files import real_folder
from tests.strategies import LIMITS

NTU = {"fps": 30.0, "max_gap": 5, "max_link_distance": 0.3, "min_visible_share": 0.5}
BVH = {
    "unit": None,
    "up": None,
    "fps": None,
    "end_sites": False,
    "skip_frames": 0,
    "max_root_distance": None,
}
PARAMS = """\
ingest:
  dataset: test
  raw: raw
  format: ntu
  settings: {fps: 30.0, max_gap: 5, max_link_distance: 0.3, min_visible_share: 0.5}
  include: ["*"]
  drop_joints: [left_thumb]
  skeleton: ""
  joint_names: []
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


def bodies(seed: int, n_frames: int = 20, apart: float = 1.0) -> Interaction:
    """Let two rigid bodies drift before the camera."""
    random = np.random.default_rng(seed)
    body = random.normal([0, 0, 3], 0.3, size=(25, 3))
    drift = 0.003 * np.arange(n_frames)[:, None, None] * random.standard_normal(3)
    person_a = (body + drift).astype(np.float32)
    person_b = (body + np.array([apart, 0, 0]) - drift).astype(np.float32)
    return Interaction(NTU25, np.arange(n_frames) / 30, person_a, person_b)


def write(folder, number, interaction):
    path = folder / f"S001C001P001R{number:03d}A050.skeleton"
    path.write_bytes(format_ntu(interaction, (72057594037932185, 72057594037932127)))
    return path


def ingest(root, name="ntu", settings=NTU, **changes):
    recipe = IngestionSettings(
        dataset="test",
        root=root,
        format=open_format(name, settings),
        drop_joints=(),
        limits=LIMITS,
        contact_distance=0.1,
        stated_fps=None,
    )
    recipe = replace(recipe, **changes)
    outcomes = list(read_sequences(recipe, recipe.format.find(root)))
    aside = [outcome for outcome in outcomes if isinstance(outcome, QuarantineRecord)]
    return [outcome for outcome in outcomes if outcome not in aside], aside


def test_every_sequence_ends_as_facts_or_as_a_reason(tmp_path):
    write(tmp_path, 1, bodies(1))
    write(tmp_path, 2, bodies(2, n_frames=5))
    write(tmp_path, 3, bodies(3, n_frames=12, apart=0.01))
    (tmp_path / "broken.skeleton").write_text("3\n2\nnonsense\n")
    (tmp_path / "S001C001P001R004A050.skeleton").write_bytes(
        write(tmp_path, 1, bodies(1)).read_bytes()
    )
    of_windows = (tmp_path / "S001C001P001R001A050.skeleton").read_bytes().replace(b"\n", b"\r\n")
    (tmp_path / "S001C001P001R005A050.skeleton").write_bytes(of_windows)
    usable, aside = ingest(tmp_path)
    assert [facts.clip for facts, _ in usable] == ["S001C001P001R001A050"]
    reasons = {row.sequence: row for row in aside}
    assert reasons["S001C001P001R002A050"].reason == "5 frames, wanted at least 10"
    assert reasons["S001C001P001R003A050"].reason.startswith("the same body twice")
    for copy in "45":
        said = reasons[f"S001C001P001R00{copy}A050"].reason
        assert said == "the same content as S001C001P001R001A050"
    assert reasons["broken"].line == 3 and reasons["broken"].file == "broken.skeleton"
    assert all(len(row.sha256) == 64 for row in aside)


def test_facts_say_where_a_clip_comes_from_and_how_good_it_is(tmp_path):
    write(tmp_path, 1, bodies(1))
    ((facts, interaction),), _ = ingest(tmp_path, drop_joints=("left_thumb",))
    assert facts.source_file == "S001C001P001R001A050.skeleton"
    assert (facts.dataset, facts.action, facts.subject_a) == ("test", "A050 punch or slap", "P001")
    assert (facts.fps, facts.frames) == (pytest.approx(30), 20)
    assert facts.bone_length_variation < 1e-3
    assert interaction.person_a.shape == (20, 24, 3)
    assert facts.skeleton == interaction.skeleton.name == "ntu25-24"


def test_a_rate_that_the_set_denies_is_a_reason(tmp_path):
    write(tmp_path, 1, bodies(1))
    usable, aside = ingest(tmp_path, stated_fps=25.0)
    assert not usable
    assert aside[0].reason == "the file's own times give 30 frames a second, wanted 25.0"


def test_the_faulty_captures_of_duo_mocap_are_put_aside_for_what_they_are():
    root = real_folder("duo_mocap")
    usable, aside = ingest(root, "bvh", {**BVH, "preset": "duo_mocap"})
    reasons = {row.file: row.reason for row in aside}
    lie, single = "faulty/jump_crawl001_S2_crawl_30fps.bvh", "faulty/ROM_30fps.bvh"
    assert reasons[lie] == "the header says 684 frames, the file has 774 rows"
    assert reasons[single].startswith("no second person: wanted names such as salsa/Easy_01_female")
    assert len(usable) == 7 and len(aside) == 2


def test_one_dancer_fitted_twice_is_no_pair():
    root = real_folder("cmu_18_19")
    usable, aside = ingest(root, "bvh", {**BVH, "preset": "cmu_18_19"})
    assert len(usable) == 12
    (twice,) = [row for row in aside if "not_a_pair" in row.file]
    assert twice.reason.startswith("the same body twice")


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


def ingest_tables(folder, monkeypatch, labels):
    """Run the stage on three tables of joints and a ``captures.csv``."""
    raw = folder / "raw"
    raw.mkdir()
    for number in range(3):
        clip = bodies(number)
        people = (clip.person_a / 2, clip.person_b / 2)  # of a stature that people have
        table = JointTable(NTU25, clip.times, people, "y", 1.0)
        (raw / f"take{number}.npz").write_bytes(npz_table(table))
    (raw / "captures.csv").write_text(f"file,action,person_a,person_b,recording\n{labels}")
    settings = PARAMS.partition("  settings:")[2].partition("\n")[0]
    text = PARAMS.replace("format: ntu", "format: table").replace(settings, " {}")
    (folder / "params.yaml").write_text(text)
    monkeypatch.chdir(folder)
    main(Path("raw"), Path("sequences"), Path("m.json"), cache=Path("cache"))
    return read_rows(folder / "sequences" / "clips.parquet", ClipRecord)


def test_tables_are_ingested_with_what_the_table_of_captures_states(tmp_path, monkeypatch):
    rows = ingest_tables(tmp_path, monkeypatch, "take1.npz,hug,anna,ben,monday\n")
    stated = [(r.clip, r.action, r.subject_a, r.subject_b, r.recording) for r in rows]
    assert stated == [
        ("take0", "", "", "", "take0"),
        ("take1", "hug", "anna", "ben", "monday"),
        ("take2", "", "", "", "take2"),
    ]
    # A label is part of what a reading is cached under.
    (tmp_path / "raw" / "captures.csv").write_text("file,action,person_a,person_b\n")
    main(Path("raw"), Path("sequences"), Path("m.json"), cache=Path("cache"))
    rows = read_rows(tmp_path / "sequences" / "clips.parquet", ClipRecord)
    assert {row.action for row in rows} == {""}


def test_a_faulty_table_of_captures_ends_the_stage_in_one_line(tmp_path, monkeypatch):
    with pytest.raises(StageError, match=r"captures.csv:2: 'take9.npz' is the file of no capture$"):
        ingest_tables(tmp_path, monkeypatch, "take9.npz,hug,anna,ben,\n")


IRREGULAR = {
    "is a pipe": os.mkfifo,
    "is a link to nothing": lambda path: path.symlink_to("nowhere"),
    "is a link out of the folder": lambda path: path.symlink_to("/dev/zero"),
    "is a folder": lambda path: path.symlink_to(".", target_is_directory=True),
}


@pytest.mark.parametrize("words", IRREGULAR)
@pytest.mark.parametrize("form", FORMATS)
def test_every_format_lists_what_is_no_file_and_ingestion_never_opens_it(tmp_path, form, words):
    folder = tmp_path / "raw" / "male"
    folder.mkdir(parents=True)
    suffix = {code: name for name, code in FORMAT_OF_SUFFIX.items()}.get(form)
    name = f"a{suffix}" if suffix else "skeleton_pos.txt"
    IRREGULAR[words](folder / name)
    settings = DEFAULT_SETTINGS[form] | ({"unit": 1.0, "up": "y"} if form == "bvh" else {})
    usable, (aside,) = ingest(tmp_path / "raw", form, settings)
    assert not usable and aside.reason.startswith(f"male/{name} {words}")
    assert aside.sha256 == ""


@pytest.mark.parametrize("words", IRREGULAR)
def test_a_skeleton_of_a_cmu_trial_that_is_no_file_is_never_opened(tmp_path, words):
    for subject in ("18", "19"):
        (tmp_path / f"{subject}_01.amc").write_text(":FULLY-SPECIFIED\n1\n")
    IRREGULAR[words](tmp_path / "18.asf")
    (aside,) = ingest(tmp_path, "cmu", DEFAULT_SETTINGS["cmu"])[1]
    assert aside.reason.startswith(f"18.asf {words}")


def test_captures_beside_refused_ones_are_read_with_the_cache_too(raw, reads):
    os.mkfifo(raw / "pipe.skeleton")
    (raw / "long").mkdir()
    write(raw / "long", 7, bodies(7)).rename(raw / f"{'n' * 190}.skeleton")
    for cache in (None, Path("cache"), Path("cache")):
        made = run("made", cache)
        rows = {
            row.sequence: row.reason
            for row in read_rows(Path("made/quarantine.parquet"), QuarantineRecord)
        }
        assert rows["pipe"] == "pipe.skeleton is a pipe, no file"
        assert rows["n" * 190].startswith("its name has 190 characters")
        assert json.loads(made[".json"])["usable"] == 2


def test_of_two_captures_with_one_name_the_first_is_used(tmp_path):
    for number, folder in enumerate(("a b", "a-u20-b")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "skeleton_pos.txt").write_text(capture(number))
    usable, (aside,) = ingest(tmp_path, "sbu", {"fps": 15})
    assert [facts.source_file for facts, _ in usable] == ["a b/skeleton_pos.txt"]
    assert aside.reason == "the name a-u20-b is that of a b/skeleton_pos.txt"


def test_names_and_reasons_with_control_characters_are_escaped(tmp_path):
    (tmp_path / "\x1b[31mred\n.skeleton").write_text("1\x1b[2J\n")
    (tmp_path / os.fsdecode(b"caf\xe9.skeleton")).write_text("1\n")
    _, aside = ingest(tmp_path)
    assert len(aside) == 2
    assert all(text.isprintable() for row in aside for text in (row.sequence, row.file, row.reason))
    write_rows(tmp_path / "rows.parquet", QuarantineRecord, aside)
    assert read_rows(tmp_path / "rows.parquet", QuarantineRecord) == aside
