"""Truth: the motion that was packed; plain percentiles and averages; a pair of a known place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25, SBU15
from pacmo_core.figures.viewer import Scene, packed_scenes
from tests.figures.samples import interaction, unpack_motion


def packed(scene: Scene) -> dict:
    return packed_scenes([scene], contact=0.1)[0]


def shifted(seen: Interaction, by: list[float]) -> Interaction:
    moved = [(m + np.array(by)).astype(np.float32) for m in (seen.person_a, seen.person_b)]
    return Interaction(seen.skeleton, seen.times, *moved)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.floats(0.1, 40), st.floats(-500, 500))
def test_a_packed_motion_is_off_by_half_a_step_at_most(seed: int, size: float, away: float) -> None:
    motion = np.random.default_rng(seed).uniform(-size, size, (6, 15, 3)) + away
    scene = Scene("x", SBU15, np.arange(6) / 30, (motion.astype(np.float32),))
    facts = packed(scene)
    assert facts["step"] <= 2 * size / 2 / 32767 * 1.001
    back = unpack_motion(facts["motions"][0], np.array(facts["origin"]), facts["step"])
    off = np.abs(back.reshape(6, 15, 3) - scene.people[0])
    assert off.max() <= facts["step"] / 2 * 1.001


def test_a_clip_of_a_room_is_off_by_a_tenth_of_a_millimetre_at_most() -> None:
    facts = packed(Scene.of("x", interaction(1)))
    assert facts["step"] / 2 <= 1e-4


def test_the_camera_sees_the_first_person_left_of_the_second() -> None:
    for seed in range(4):
        seen = interaction(seed)
        yaw = packed(Scene.of("x", seen))["view"]["yaw"]
        right = np.array([np.cos(yaw), 0, -np.sin(yaw)])
        assert ((seen.person_b - seen.person_a).mean(axis=(0, 1)) @ right) > 0.5


def test_scenes_of_one_world_share_a_view_and_others_have_their_own() -> None:
    seen = interaction(1)
    turned = Interaction(seen.skeleton, seen.times, seen.person_b, seen.person_a)
    far = shifted(turned, [3, 0, 0])
    first, answer, other = packed_scenes(
        [Scene.of(name, one) for name, one in (("a", seen), ("b", turned), ("c", far))], contact=0.1
    )
    assert answer["view"] == first["view"]
    assert abs(other["view"]["yaw"] - first["view"]["yaw"]) > 3


def test_moving_everything_moves_the_view_along() -> None:
    seen = interaction(2, NTU25)
    here, there = (packed(Scene.of("x", s))["view"] for s in (seen, shifted(seen, [5, 1, -2])))
    np.testing.assert_allclose(np.subtract(there["centre"], here["centre"]), [5, -2], atol=1e-3)
    assert there["ground"] - here["ground"] == pytest.approx(1, abs=1e-3)
    assert there["near"] == pytest.approx(here["near"], abs=1e-3)
    assert there["reach"] == pytest.approx(here["reach"], abs=1e-3)


def test_three_people_and_wrong_shapes_are_refused() -> None:
    seen = interaction(1)
    with pytest.raises(ValueError, match="one or two"):
        Scene("x", SBU15, seen.times, (seen.person_a,) * 3)
    with pytest.raises(ValueError, match="wanted one or two of"):
        Scene("x", NTU25, seen.times, (seen.person_a,))
