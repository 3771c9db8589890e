"""What is trusted: the folders of the published SBU set, which name the people of every clip."""

import os
from collections import Counter
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from pacmo_core.data.splits import ClipOrigin, SplitRule, assign_splits

ROOT = Path(__file__).parents[2]
SBU = Path(os.environ.get("PACMO_REAL_DATA", ROOT.parent / "shared" / "data")) / "sbu"
pytestmark = pytest.mark.skipif(not SBU.is_dir(), reason=f"no captures in {SBU}")


def origins():
    takes = sorted(file.parent.relative_to(SBU) for file in SBU.rglob("skeleton_pos.txt"))
    return [ClipOrigin(str(t), str(t), (t.parts[0][:3], t.parts[0][3:])) for t in takes]


def folds(name):
    """Split as an experiment says, fold by fold."""
    read = YAML(typ="safe").load
    default, changes = (read(ROOT / "experiments" / f"{n}.yaml") for n in ("default", name))
    values = {**default["split"], **changes["split"]}
    listed = {key: tuple(map(tuple, values[key])) for key in ("test_pairs", "test_people")}
    rule = SplitRule(**{**values, **listed})
    return [assign_splits(origins(), rule, fold) for fold in changes["runs"]["folds"]]


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


def test_the_published_folds_test_every_clip_once_and_drop_none():
    found = folds("sbu_pairs")
    assert len(found) == 5
    for clip in found[0]:
        assert sorted(splits[clip] == "test" for splits in found) == [False] * 4 + [True]
    assert all("dropped" not in splits.values() for splits in found)
