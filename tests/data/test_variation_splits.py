"""Oracle: the definitions of the splits, checked for each variation."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from pacmo_core.data.variation_splits import (
    SPLIT_METHODS,
    SplitSettings,
    VariationScales,
    assign_splits,
    limit_training_samples,
)

STEPS = [round(0.75 + 0.05 * i, 2) for i in range(11) if i != 5]
SETTINGS = SplitSettings(
    held_out=frozenset({"m2"}), test_share=0.2, validation_share=0.1, random_seed=1
)


def variations():
    """List each scale of each of two bones of either body, of four motions."""
    result = []
    for source in ("m1", "m2", "m3", "m4"):
        for scale in STEPS:
            for body in (0, 1):
                for bone in (0, 1):
                    scales = np.ones((2, 2))
                    scales[body, bone] = scale
                    result.append(VariationScales(source, scales))
    return result


VARIATIONS = variations()


def scales_of(splits, split):
    """List the scales on a split."""
    chosen = [f for f, own in zip(VARIATIONS, splits, strict=True) if own == split]
    return {round(float(f.scales[f.scales != 1][0]), 2) for f in chosen}


def sources_of(splits, split):
    return {f.source for f, own in zip(VARIATIONS, splits, strict=True) if own == split}


def test_across_scales_near_bodies_train_and_far_ones_are_tested():
    splits = assign_splits("cross_scale", VARIATIONS, SETTINGS)
    assert scales_of(splits, "train") == {0.95, 1.05}
    assert scales_of(splits, "validation") == {0.9, 1.1}
    assert scales_of(splits, "test") == {0.75, 0.8, 0.85, 1.15, 1.2, 1.25}
    assert "dropped" not in splits


def test_across_interactions_the_held_out_motion_alone_is_tested():
    splits = assign_splits("cross_interaction", VARIATIONS, SETTINGS)
    assert sources_of(splits, "test") == {"m2"}
    assert sources_of(splits, "train") == {"m1", "m3", "m4"}
    assert scales_of(splits, "test") == scales_of(splits, "train") == set(STEPS)


def test_across_interactions_whole_motions_validate_where_there_are_enough():
    more = [replace(v, source=f"{v.source}{k}") for v in VARIATIONS for k in range(2)]
    splits = assign_splits(
        "cross_interaction", more, replace(SETTINGS, held_out=frozenset({"m20"}))
    )
    sides = {
        side: {v.source for v, own in zip(more, splits, strict=True) if own == side}
        for side in ("train", "validation", "test")
    }
    assert sides["test"] == {"m20"}
    assert [len(sides[side]) for side in ("train", "validation")] == [6, 1]
    assert not sides["train"] & sides["validation"]


def test_across_both_far_bodies_of_the_held_out_motion_are_tested():
    splits = assign_splits("cross_scale_interaction", VARIATIONS, SETTINGS)
    assert sources_of(splits, "test") == {"m2"}
    assert sources_of(splits, "train") == {"m1", "m3", "m4"}
    assert scales_of(splits, "train") == {0.95, 1.05}
    assert scales_of(splits, "test") == {0.75, 0.8, 0.85, 1.15, 1.2, 1.25}


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(0, 1000))
def test_the_random_split_has_its_shares_and_its_seed(seed):
    chosen = SplitSettings(
        held_out=frozenset(), test_share=0.2, validation_share=0.1, random_seed=seed
    )
    splits = assign_splits("random", VARIATIONS, chosen)
    assert splits == assign_splits("random", VARIATIONS, chosen)
    assert splits.count("test") == round(0.2 * len(VARIATIONS))
    assert splits.count("validation") == round(0.1 * (len(VARIATIONS) - splits.count("test")))
    assert sources_of(splits, "test") == sources_of(splits, "train")


@pytest.mark.parametrize("kind", SPLIT_METHODS)
def test_fewer_samples_nest_and_leave_other_sides_alone(kind):
    splits = assign_splits(kind, VARIATIONS, SETTINGS)
    selected = {24: None, 12: None, 6: None}
    for n in selected:
        less = limit_training_samples(splits, n, random_seed=3)
        selected[n] = {row for row, split in enumerate(less) if split == "train"}
        assert len(selected[n]) == n
        others = [(a, b) for a, b in zip(splits, less, strict=True) if a != "train"]
        assert all(a == b for a, b in others)
    assert selected[6] < selected[12] < selected[24]


def test_errors_are_named():
    with pytest.raises(ValueError, match="split must be one of random.*'by_person'"):
        assign_splits("by_person", VARIATIONS, SETTINGS)
    absent = SplitSettings(
        held_out=frozenset({"m9"}), test_share=0.2, validation_share=0, random_seed=0
    )
    with pytest.raises(ValueError, match=r"held_out must be sources; \['m9'\]"):
        assign_splits("cross_interaction", VARIATIONS, absent)
    far = [f for f in VARIATIONS if f.scale_group == "far" and f.source == "m2"][:4]
    with pytest.raises(ValueError, match="nothing to train on among 4"):
        assign_splits("cross_scale", far, SETTINGS)
    with pytest.raises(ValueError, match="training samples must be 1 to"):
        limit_training_samples(["train", "test"], 2, random_seed=0)
    with pytest.raises(ValueError, match=r"test_share must lie in \(0, 1\)"):
        SplitSettings(held_out=frozenset(), test_share=1, validation_share=0, random_seed=0)
