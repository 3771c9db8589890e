"""What is trusted: names written out by the test, and the order of strings."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.names import (
    DIRECTIONS,
    MAX_SAMPLES,
    ReactionName,
    clip_name,
    directed_name,
    direction_of,
    is_reaction,
    sample_name,
    sort_clips,
    split_variation_name,
    variation_name,
)

CLIPS = st.text("ab09_./-#", min_size=1, max_size=6)
KINDS = st.text("ab09_.-", min_size=1, max_size=6)
FIXED = settings(derandomize=True, deadline=None, max_examples=100)


def test_a_sequence_that_is_one_clip_keeps_its_name() -> None:
    assert clip_name("s01/02", 0, 1) == "s01/02"
    assert [clip_name("s01/02", k, 2) for k in (0, 1)] == ["s01/02#0000", "s01/02#0001"]


@FIXED
@given(CLIPS, st.sampled_from(DIRECTIONS), st.integers(0, MAX_SAMPLES - 1))
def test_a_reactions_name_is_parsed_as_it_was_written(clip, direction, sample) -> None:
    name = ReactionName(clip, direction, sample)
    assert str(name) == f"{clip}#{direction}#{sample}" == sample_name(name.directed, sample)
    assert ReactionName.parse(str(name)) == name
    assert direction_of(name.directed) == direction


@pytest.mark.parametrize("name", ["clip", "clip#b", "clip#0001", "clip#c#0", "#b#0", "clip#b#x"])
def test_what_is_no_reactions_name_is_refused(name) -> None:
    assert not is_reaction(name)
    with pytest.raises(ValueError, match=f"wanted the name of a reaction.*got {name}"):
        ReactionName.parse(name)


def test_a_clip_without_direction_is_refused() -> None:
    with pytest.raises(ValueError, match="got clip#0001"):
        direction_of("clip#0001")


@FIXED
@given(CLIPS, KINDS)
def test_a_variations_name_is_split_as_it_was_joined(clip, kind) -> None:
    assert split_variation_name(variation_name(clip, kind)) == (clip, kind)
    assert split_variation_name(clip) == (clip, "")


@FIXED
@given(st.sets(CLIPS, max_size=8), st.sets(KINDS, min_size=1, max_size=3))
def test_variations_ascend_over_all_clips(clips, kinds) -> None:
    names = [variation_name(clip, kind) for clip in sort_clips(clips) for kind in sorted(kinds)]
    assert names == sorted(names)


@FIXED
@given(st.sets(CLIPS, max_size=8))
def test_directed_names_are_unique(clips) -> None:
    names = {directed_name(clip, direction) for clip in clips for direction in DIRECTIONS}
    assert len(names) == 2 * len(clips)
