"""Trusted: what a wrong partner is: another clip's, within the act where one is asked for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.metrics.controls import (
    is_permutable,
    permute_partners,
    second_samples,
    split_halves_by_clip,
)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 9), st.integers(1, 3), st.booleans())
def test_no_reaction_stays_in_its_clip_and_each_is_used_once_in_its_act(seed, per_act, acts, same):
    rng = np.random.default_rng(seed)
    clips = np.repeat([f"c{i}" for i in range(per_act * acts)], 2)
    act_of = np.repeat([f"act{i}" for i in range(acts)], 2 * per_act)
    order = rng.permutation(len(clips))
    clips, act_of = clips[order], act_of[order]
    chosen = permute_partners(list(clips), list(act_of) if same else None, rng)
    assert sorted(chosen) == list(range(len(clips)))
    assert (clips[chosen] != clips).all()
    if same:
        assert (act_of[chosen] == act_of).all()


def test_one_random_seed_gives_one_choice_and_another_another():
    clips = [f"c{i // 2}" for i in range(40)]
    first, again, other = (
        permute_partners(clips, None, np.random.default_rng(s)) for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_every_wrong_partner_is_about_as_likely():
    clips, rng = ["a", "a", "b", "b", "c", "c"], np.random.default_rng(0)
    taken = np.zeros((6, 6))
    for _ in range(2000):
        taken[np.arange(6), permute_partners(clips, None, rng)] += 1 / 2000
    expected = np.kron(1 - np.eye(3), np.ones((2, 2))) / 4
    np.testing.assert_allclose(taken, expected, atol=0.05)


def test_an_action_of_one_clip_has_no_wrong_partner():
    clips, acts = ["a", "a", "b", "b", "c"], ["hug", "hug", "kick", "kick", "kick"]
    np.testing.assert_array_equal(is_permutable(clips, acts), False)
    np.testing.assert_array_equal(
        is_permutable([*clips, "d"], [*acts, "kick"]), [False, False, *[True] * 4]
    )
    with pytest.raises(ValueError, match="action hug"):
        permute_partners(clips, acts, np.random.default_rng(0))


def test_where_there_are_no_more_samples_than_tested_there_is_one_second_draw():
    (drawn,) = second_samples(["a", "b", "b"], 22, 5, np.random.default_rng(0))
    assert sorted(drawn) == [0, 1, 2]


def test_a_second_draw_takes_whole_clips_and_halves_share_none():
    clips = [f"c{i % 7}" for i in range(21)]
    rng = np.random.default_rng(0)
    draws = second_samples(clips, 9, 4, rng)
    assert len(draws) == 4 and len({tuple(sorted(drawn)) for drawn in draws}) > 1
    for drawn in draws:
        assert len({*drawn}) == 9
        assert len({clips[i] for i in drawn}) == 3
    one, other = split_halves_by_clip(clips, rng)
    assert sorted([*one, *other]) == list(range(21))
    assert not {clips[i] for i in one} & {clips[i] for i in other}
    assert {len(one), len(other)} == {9, 12}
    with pytest.raises(ValueError, match="2 clips"):
        split_halves_by_clip(["a", "a"], rng)
