"""What is trusted: the definition of each split; that windows tile the recording.

The folders of the published SBU set name the people of every clip.
"""

import hashlib
import itertools
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from pacmo_core.data.splits import (
    ClipOrigin,
    SplitRule,
    assign_splits,
    resolve_method,
    window_edges,
)

RULE = SplitRule(
    method="clip",
    test_share=0.2,
    validation_share=0.1,
    validation_by="recording",
    min_people=6,
    test_pairs=(),
    test_people=(),
    test_recordings=(),
    random_seed=0,
)


def circle(n_people, clips_a_pair=4):
    """Every person with the next two, some clips each."""
    return [
        ClipOrigin(
            f"c{a}-{step}-{k}", f"r{a}-{step}-{k // 2}", (f"p{a}", f"p{(a + step) % n_people}")
        )
        for a in range(n_people)
        for step in (1, 2)
        for k in range(clips_a_pair)
    ]


@pytest.mark.parametrize("method", ["clip", "recording", "pair", "person"])
def test_adding_captures_moves_no_other_clip(method):
    rule = replace(RULE, method=method)
    before = assign_splits(circle(40)[:-50], rule, 1)
    after = assign_splits(circle(40), rule, 1)
    assert all(after[clip] == split for clip, split in before.items())


@pytest.mark.parametrize(
    ("method", "unit"),
    [
        ("recording", lambda o: {o.recording}),
        ("pair", lambda o: {o.pair}),
        ("person", lambda o: o.people),
    ],
)
def test_nothing_that_must_stay_together_stands_on_both_sides(method, unit):
    origins = circle(40)
    splits = assign_splits(origins, replace(RULE, method=method), 1)
    trained = {u for o in origins if splits[o.clip] in ("train", "validation") for u in unit(o)}
    tested = {u for o in origins if splits[o.clip] == "test" for u in unit(o)}
    assert trained and tested and not trained & tested


def test_only_a_split_by_person_drops_clips_and_only_mixed_ones():
    origins = circle(40)
    for method in ("clip", "recording", "pair"):
        assert "dropped" not in assign_splits(origins, replace(RULE, method=method), 1).values()
    splits = assign_splits(origins, replace(RULE, method="person"), 1)
    tested = {p for o in origins if splits[o.clip] == "test" for p in o.people}
    for origin in origins:
        if splits[origin.clip] == "dropped":
            assert len(set(origin.people) & tested) <= 1


def test_shares_are_met_on_average():
    origins = [ClipOrigin(f"c{k}", f"r{k}", ()) for k in range(5000)]
    splits = list(assign_splits(origins, RULE, 1).values())
    assert splits.count("test") / 5000 == pytest.approx(0.2, abs=0.02)
    assert splits.count("validation") / 5000 == pytest.approx(0.08, abs=0.015)


def test_what_is_validation_does_not_hang_on_what_is_test():
    origins = [ClipOrigin(f"c{k}", f"r{k}", ()) for k in range(5000)]
    splits = list(assign_splits(origins, replace(RULE, method="recording"), 1).values())
    assert splits.count("validation") / splits.count("train") == pytest.approx(0.1 / 0.9, abs=0.02)


def test_validation_takes_whole_recordings_or_single_clips_of_them():
    origins = [ClipOrigin(f"c{k}", f"r{k // 10}", ()) for k in range(1000)]
    for unit, parted in (("recording", 0), ("clip", 50)):
        rule = replace(RULE, method="recording", validation_by=unit, validation_share=0.2)
        splits = assign_splits(origins, rule, 1)
        mixed = [
            {"train", "validation"} <= {splits[f"c{10 * r + k}"] for k in range(10)}
            for r in range(100)
        ]
        assert bool(parted) == (sum(mixed) > parted)
    with pytest.raises(ValueError, match="validation_by must be recording or clip; got frame"):
        replace(RULE, validation_by="frame")


def test_another_seed_gives_another_split():
    origins = circle(40)
    assert assign_splits(origins, RULE, 1) != assign_splits(
        origins, replace(RULE, random_seed=1), 1
    )


def test_auto_means_person_only_where_enough_people_are_known():
    auto = replace(RULE, method="auto")
    assert resolve_method(circle(10), auto) == "person"
    assert resolve_method(circle(5), auto) == "recording"
    assert resolve_method([*circle(10), ClipOrigin("x", "x", ())], auto) == "recording"


def test_listed_pairs_are_tested_in_the_order_that_their_data_set_gives_them():
    rule = replace(RULE, method="listed", validation_share=0, test_pairs=(("p0+p1",), ("p0+p2",)))
    origins = [
        ClipOrigin(f"{a}{b}", "r", (a, b)) for a, b in (("p0", "p1"), ("p1", "p0"), ("p0", "p2"))
    ]
    first, second = (assign_splits(origins, rule, fold) for fold in (1, 2))
    assert first == {"p0p1": "test", "p1p0": "train", "p0p2": "train"}
    assert second == {"p0p1": "train", "p1p0": "train", "p0p2": "test"}


def test_of_listed_people_both_are_tested_neither_is_trained_on_and_the_rest_is_dropped():
    rule = replace(RULE, method="listed_people", test_people=(("p0",), ("p1", "p2", "p3")))
    origins = circle(8)
    splits = assign_splits(origins, rule, 2)
    for origin in origins:
        listed = len({"p1", "p2", "p3"} & {*origin.people})
        wanted = {0: ("train", "validation"), 1: ("dropped",), 2: ("test",)}[listed]
        assert splits[origin.clip] in wanted


def test_listed_recordings_are_tested_whole_and_the_rest_is_trained_on_and_validated():
    origins = [
        ClipOrigin(f"{kind}_{k}#{part}", f"{kind}_{k}", ())
        for kind, n in (("normal", 100), ("variation", 20), ("other", 5))
        for k in range(n)
        for part in range(3)
    ]
    folds = (("variation_*",), ("other_[01]", "normal_7"))
    rule = replace(RULE, method="listed_recordings", test_recordings=folds)
    first, second = (assign_splits(origins, rule, fold) for fold in (1, 2))
    tested = [{o.recording for o in origins if s[o.clip] == "test"} for s in (first, second)]
    assert tested == [{f"variation_{k}" for k in range(20)}, {"other_0", "other_1", "normal_7"}]
    for split in (first, second):
        parts = {
            o.recording: {split[p.clip] for p in origins if p.recording == o.recording}
            for o in origins
        }
        assert {len(names) for names in parts.values()} == {1}
    left = Counter(split for split in first.values() if split != "test")
    assert left["validation"] / left["train"] == pytest.approx(0.1, abs=0.06)
    with pytest.raises(ValueError, match=r"fold 1 lists varied_\*, of whom .*; there are normal_0"):
        assign_splits(origins, replace(rule, test_recordings=(("varied_*",),)), 1)


@pytest.mark.parametrize("method", ["clip", "recording", "pair"])
def test_the_folds_of_a_hashed_split_test_everything_once(method):
    origins = circle(40)
    folds = [assign_splits(origins, replace(RULE, method=method), fold) for fold in range(1, 6)]
    tested = [clip for splits in folds for clip, split in splits.items() if split == "test"]
    assert sorted(tested) == sorted(origin.clip for origin in origins)


def test_a_fold_tests_its_own_slice_of_the_hash():
    """As BLAKE2b gives it, written out here anew."""
    origins = [ClipOrigin(f"c{k}", f"r{k}", ()) for k in range(200)]
    splits = assign_splits(origins, RULE, 3)
    for origin in origins:
        digest = hashlib.blake2b(f"0\0clip\0{origin.clip}".encode(), digest_size=8).digest()
        tested = 0.4 <= int.from_bytes(digest, "big") / 2**64 < 0.6
        assert (splits[origin.clip] == "test") == tested


@pytest.mark.parametrize(
    ("fault", "fold", "said"),
    [
        ({}, 6, "fold must be 1 to 5, as many as of test_share 0.2 fit into 1; got 6"),
        ({}, 0, "fold must be 1 to 5"),
        ({"test_share": 0.3}, 4, "fold must be 1 to 3"),
        ({"method": "listed", "test_pairs": (("p0+p1",),)}, 2, "1 to 1, as many as are listed"),
        ({"method": "listed_people"}, 1, "1 to 0, as many as are listed"),
        ({"method": "listed", "test_pairs": (("p0+p9",),)}, 1, "fold 1 lists p0.p9, of whom"),
        ({"method": "listed_people", "test_people": (("p0", "px"),)}, 1, "fold 1 lists px"),
    ],
)
def test_a_fold_or_a_name_that_there_is_not_is_refused(fault, fold, said):
    with pytest.raises(ValueError, match=said):
        assign_splits(circle(8), replace(RULE, **fault), fold)


def test_as_many_folds_as_fit_are_there_whatever_their_share_rounds_to():
    replace(RULE, test_share=1 / 93).check_fold(93)


def test_a_clip_of_unknown_people_cannot_be_split_by_person():
    rule = replace(RULE, method="listed_people", test_people=(("p0", "p1"),))
    with pytest.raises(ValueError, match="clip x has none|x has none"):
        assign_splits([*circle(8), ClipOrigin("x", "x", ())], rule, 1)


def test_an_empty_side_is_refused_with_the_seed():
    with pytest.raises(ValueError, match="random_seed 0 leaves no"):
        assign_splits([ClipOrigin("x", "x", ("p", "q"))], RULE, 1)


@pytest.mark.parametrize("fault", [{"method": "luck"}, {"test_share": 1.5}])
def test_a_rule_that_makes_no_sense_is_refused(fault):
    with pytest.raises(ValueError, match="must"):
        replace(RULE, **fault)


@settings(derandomize=True)
@given(
    n_frames=st.integers(2, 5000),
    fps=st.sampled_from([15.0, 30.0, 119.88]),
    seconds=st.floats(0.01, 8),
)
def test_windows_tile_the_recording_evenly(n_frames, fps, seconds):
    edges = window_edges(n_frames, fps, seconds)
    assert edges[0][0] == 0 and edges[-1][1] == n_frames
    assert all(stop == start for (_, stop), (start, _) in itertools.pairwise(edges))
    lengths = [stop - start for start, stop in edges]
    assert max(lengths) - min(lengths) <= 1
    assert min(lengths) >= 2
    if n_frames / fps > 1.5 * seconds > 9 / fps:
        assert seconds / 2 < max(lengths) / fps < 2 * seconds


ROOT = Path(__file__).parents[2]
SBU = Path(os.environ.get("PACMO_REAL_DATA", ROOT.parent / "shared" / "data")) / "sbu"
needs_sbu = pytest.mark.skipif(not SBU.is_dir(), reason=f"no captures in {SBU}")


def origins():
    takes = sorted(file.parent.relative_to(SBU) for file in SBU.rglob("skeleton_pos.txt"))
    return [ClipOrigin(str(t), str(t), (t.parts[0][:3], t.parts[0][3:])) for t in takes]


def folds(name):
    """Split as an experiment says, fold by fold."""
    read = YAML(typ="safe").load
    default, changes = read(ROOT / "params.yaml"), read(ROOT / "experiments" / f"{name}.yaml")
    values = {**default["split"], **changes["split"]}
    listed = {
        key: tuple(map(tuple, values[key]))
        for key in ("test_pairs", "test_people", "test_recordings")
    }
    rule = SplitRule(**{**values, **listed})
    return [assign_splits(origins(), rule, fold) for fold in changes["runs"]["folds"]]


@needs_sbu
def test_by_person_every_fold_leaves_enough_and_no_clip_is_tested_twice():
    people = {origin.clip: {*origin.people} for origin in origins()}
    tested = Counter()
    for splits in folds("sbu"):
        sizes = Counter(splits.values())
        assert sizes["train"] >= 80 and sizes["test"] >= 20 and sizes["validation"]
        by_side = {split: set() for split in sizes}
        for clip, split in splits.items():
            by_side[split] |= people[clip]
        assert not by_side["test"] & (by_side["train"] | by_side["validation"])
        tested.update(clip for clip, split in splits.items() if split == "test")
    assert max(tested.values()) == 1
    assert len({Path(clip).parts[0] for clip in tested}) == 15


@needs_sbu
def test_the_published_folds_test_every_clip_once_and_drop_none():
    found = folds("sbu_pairs")
    assert len(found) == 5
    for clip in found[0]:
        assert sorted(splits[clip] == "test" for splits in found) == [False] * 4 + [True]
    assert all("dropped" not in splits.values() for splits in found)
