"""What is trusted: clips written down here, and the splits that the test put them on."""

from dataclasses import replace

import numpy as np
import pytest
from ruamel.yaml import YAML

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import SBU15
from pacmo_core.store.motions import stream_motions, write_motions
from pacmo_core.store.tables import ClipRecord, SplitRecord, read_rows, write_rows
from stages import cut, split
from stages.common.clips import directed_clips, stream_split, write_reactions
from stages.common.files import CLIPS, MOTIONS, read_json

FACTS = ClipRecord(
    *("", "", "set", "waving", "", "", "", "sbu15"), 10.0, 1.9, 20, 0, "file", "ab",
    *(0.1, 2.0, 0.0, 0), False,
)  # fmt: skip
PEOPLE = [("p0", "p1"), ("p2", "p3"), ("p1", "p2"), ("p4", "p5"), ("p5", "p4")]


def interaction(number, n_frames=20):
    motions = np.full((2, n_frames, 15, 3), [[[[number]]], [[[number + 0.5]]]], np.float32)
    return Interaction(SBU15, np.arange(n_frames) / 10, *motions)


@pytest.fixture
def clips(tmp_path):
    """Write five sequences as clips, of people as in ``PEOPLE``."""
    rows = [
        replace(FACTS, clip=f"c{k}", sequence=f"c{k}", recording=f"r{k}", subject_a=a, subject_b=b)
        for k, (a, b) in enumerate(PEOPLE)
    ]
    write_rows(tmp_path / "clips" / CLIPS, ClipRecord, rows)
    with write_motions(tmp_path / "clips" / MOTIONS, SBU15) as writer:
        for k, row in enumerate(rows):
            writer.add(row.clip, interaction(k))
    return tmp_path / "clips"


def put(path, splits):
    write_rows(
        path, SplitRecord, [SplitRecord(clip, split_name) for clip, split_name in splits.items()]
    )
    return path


SPLITS = {"c0": "test", "c1": "train", "c2": "dropped", "c3": "validation", "c4": "test"}


def test_the_clips_of_a_split_are_those_of_the_table(clips, tmp_path):
    splits = put(tmp_path / "1.parquet", SPLITS)
    found = {
        split_name: [f.clip for f, _ in stream_split(clips, splits, split_name)]
        for split_name in ("train", "validation", "test")
    }
    assert found == {"train": ["c1"], "validation": ["c3"], "test": ["c0", "c4"]}


@pytest.mark.parametrize("splits", [{"c0": "test"}, {**SPLITS, "c9": "test"}])
def test_a_table_of_other_clips_is_refused(clips, tmp_path, splits):
    table = put(tmp_path / "1.parquet", splits)
    with pytest.raises(ValueError, match=r"wanted a split for each clip .* differ in c[129]"):
        list(stream_split(clips, table, "test"))


def test_either_person_answers_once_a_sample_and_names_say_which(clips, tmp_path):
    splits = put(tmp_path / "1.parquet", SPLITS)

    def react(name, facts, seen):
        return [seen.person_a + k for k in (1, 2)]

    write_reactions(clips, splits, tmp_path, react)
    found = dict(stream_motions(tmp_path / MOTIONS))
    assert list(found) == [f"{c}#{p}#{k}" for c in ("c0", "c4") for p in "ab" for k in "01"]
    assert (found["c4#a#1"].person_a == 4.5).all(), "b is the partner of a"
    assert (found["c4#a#1"].person_b == 6.5).all()
    assert [n for n, _, _ in directed_clips(clips, splits, "train")] == ["c1#a", "c1#b"]


def test_more_reactions_than_names_can_count_are_refused(clips, tmp_path):
    splits = put(tmp_path / "1.parquet", SPLITS)
    with pytest.raises(ValueError, match="c0#a: wanted at most 10"):
        write_reactions(clips, splits, tmp_path, lambda name, facts, seen: [seen.person_a] * 11)


def test_the_stage_writes_a_split_a_clip_of_its_fold_and_counts_them(
    clips, tmp_path, monkeypatch, capsys
):
    rule = {
        "method": "listed_people", "test_share": 0.2, "validation_share": 0,
        "validation_by": "recording", "min_people": 2, "test_pairs": [],
        "test_people": [["p2", "p3"], ["p4", "p5"]], "test_recordings": [], "random_seed": 1,
    }  # fmt: skip
    YAML(typ="safe").dump({"split": rule}, tmp_path / "params.yaml")
    monkeypatch.chdir(tmp_path)
    split.main(clips, tmp_path / "2.parquet", tmp_path / "2.json", fold=2)
    assert {row.clip: row.split for row in read_rows(tmp_path / "2.parquet", SplitRecord)} == {
        **dict.fromkeys(("c0", "c1", "c2"), "train"), **dict.fromkeys(("c3", "c4"), "test")
    }  # fmt: skip
    counts = read_json(tmp_path / "2.json")
    assert (counts["train"], counts["test"], counts["dropped"]) == (3, 2, 0)
    assert (counts["people"], counts["tested_people"], counts["tested_recordings"]) == (6, 2, 2)
    assert capsys.readouterr().out == (
        "fold 2: 5 clips and 6 people, split by listed_people: 3 train, 2 test; "
        "tested are 2 recordings (2 people)\n"
    )


def test_cut_windows_follow_on_and_name_their_start(clips, tmp_path, monkeypatch):
    YAML(typ="safe").dump({"cut": {"clip_seconds": 1.0}}, tmp_path / "params.yaml")
    monkeypatch.chdir(tmp_path)
    cut.main(clips, tmp_path / "cut")
    rows = read_rows(tmp_path / "cut" / CLIPS, ClipRecord)
    assert [row.clip for row in rows][:3] == ["c0#0000", "c0#0001", "c1#0000"]
    assert [(row.start_frame, row.frames) for row in rows][:2] == [(0, 10), (10, 10)]
    assert [name for name, _ in stream_motions(tmp_path / "cut" / MOTIONS)] == [
        r.clip for r in rows
    ]
