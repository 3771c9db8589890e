"""Truth: contacts drawn from a known law of distance and speed, and pairs found by a loop."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import SBU15
from pacmo_core.finish.contacts import (
    BODY_CONTACT_DISTANCE,
    CONTACT_DISTANCE,
    MAX_DISTANCE,
    Pairs,
    end_effector_groups,
    find_pairs,
    learn_contacts,
    no_contacts,
    predict_contacts,
)
from tests.reaction.problems import REST

LEFT, RIGHT = SBU15.joints.index("left_hand"), SBU15.joints.index("right_hand")
ENDS = list(SBU15.end_effectors)
GROUPS = end_effector_groups(SBU15)
HANDS = GROUPS[ENDS.index(LEFT)]
HAND_TO_HAND = int(HANDS * (GROUPS.max() + 1) + HANDS)
FPS = 30.0


def at_distances(distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a partner 5 m away but for the right hand, at distances from the reaction's left."""
    n = len(distances)
    reaction = np.tile(REST, (n, 1, 1)).astype(np.float32)
    partner = reaction + np.array([0, 0, 5], np.float32)
    partner[:, RIGHT] = reaction[:, LEFT] + np.stack(
        [distances, 0 * distances, 0 * distances], axis=1
    )
    return partner, reaction


def hands(distance: np.ndarray, speed: np.ndarray) -> Pairs:
    """Return one pair of hands in each frame."""
    joint = np.zeros((len(distance), 1), dtype=np.intp)
    return Pairs(np.array([HAND_TO_HAND]), joint, joint, distance[:, None], speed[:, None])


def contact_model(wanted: float = 0.04) -> np.ndarray:
    """Return a model of hands alone: in contact within 25 cm, less when they are fast."""
    model = no_contacts(SBU15)
    model[HAND_TO_HAND] = [10, -40, -10, wanted]
    return model


def test_mirror_images_share_a_group():
    groups = dict(zip([SBU15.joints[end] for end in ENDS], GROUPS, strict=True))
    assert groups["left_hand"] == groups["right_hand"] != groups["left_foot"]
    assert len({*groups.values()}) == 3


def test_pairs_are_those_of_a_loop():
    random = np.random.default_rng(0)
    reaction, partner = random.standard_normal((2, 4, 15, 3)).astype(np.float32)
    found = find_pairs(reaction, partner, FPS, SBU15)
    inner = [joint for joint in range(15) if joint not in ENDS]
    for t in range(4):
        gaps = np.linalg.norm(reaction[t][:, None] - partner[t], axis=-1)
        expected = {(own, other) for own in ENDS for other in ENDS}
        expected |= {(own, inner[gaps[own, inner].argmin()]) for own in ENDS}
        expected |= {(inner[gaps[inner, other].argmin()], other) for other in ENDS}
        pairs = list(zip(found.joint[t].tolist(), found.partner_joint[t].tolist(), strict=True))
        assert set(pairs) == expected
        assert len(pairs) == len(expected)
        np.testing.assert_allclose(found.distance[t], [gaps[pair] for pair in pairs], rtol=1e-6)


def test_the_speed_of_a_pair_is_that_between_its_joints():
    times = np.arange(60) / FPS
    partner, reaction = at_distances(0.1 + 0.5 * times)
    drift = (2.0 * times)[:, None, None] * np.array([0, 0, 1], np.float32)
    found = find_pairs(reaction + drift, partner + drift, FPS, SBU15)
    pair = np.flatnonzero((found.joint[0] == LEFT) & (found.partner_joint[0] == RIGHT))
    np.testing.assert_allclose(found.speed[10:-10, pair], 0.5, rtol=1e-4)


def test_the_law_by_which_contacts_were_drawn_is_found():
    random = np.random.default_rng(0)
    distance, speed = random.uniform(0, 0.4, 20000), random.uniform(0, 1.5, 20000)
    touching = random.uniform(size=20000) < 1 / (1 + np.exp(-(4 - 20 * distance - 2 * speed)))
    captured = np.where(touching, 0.05, 0.5)
    learnt = learn_contacts([(hands(distance, speed), hands(captured, 0 * speed))], SBU15)
    np.testing.assert_allclose(learnt[HAND_TO_HAND], [4, -20, -2, 0.05], rtol=0.06)
    others = np.arange(len(learnt)) != HAND_TO_HAND
    np.testing.assert_array_equal(learnt[others], no_contacts(SBU15)[others])


def test_a_body_is_touched_at_its_skin_and_a_hand_at_its_joint():
    random = np.random.default_rng(1)
    distance = random.uniform(0, 0.4, 2000)
    touching = random.uniform(size=2000) < 1 / (1 + np.exp(-(4 - 20 * distance)))
    skin = BODY_CONTACT_DISTANCE - 0.01
    assert skin > CONTACT_DISTANCE
    captured = np.where(touching, skin, 0.5)
    to_body = int(GROUPS.max() + 1) ** 2 + int(HANDS)
    for kind, learnt_at in ((HAND_TO_HAND, None), (to_body, skin)):
        pairs = [
            replace(hands(values, np.zeros(2000)), kind=np.array([kind]))
            for values in (distance, captured)
        ]
        model = learn_contacts([(pairs[0], pairs[1])], SBU15)
        if learnt_at is None:
            np.testing.assert_array_equal(model, no_contacts(SBU15))
        else:
            assert model[kind, 3] == pytest.approx(skin)


@pytest.mark.parametrize("captured", [0.05, 0.5])
def test_kinds_that_are_always_or_never_in_contact_are_not_learnt(captured):
    near, still = np.full(100, 0.05), np.zeros(100)
    pairs = [(hands(near, still), hands(np.full(100, captured), still))]
    np.testing.assert_array_equal(learn_contacts(pairs, SBU15), no_contacts(SBU15))


def test_a_contact_that_is_likely_is_closed_and_an_unlikely_one_is_left():
    distances = np.repeat([0.1, 0.2, 0.3, 0.6], 30)
    partner, reaction = at_distances(distances)
    found = predict_contacts(reaction, partner, FPS, SBU15, contact_model())
    # Away from the jumps, where the hand is fast.
    middle = {10: 0.04, 40: 0.04}
    for frame in (10, 40, 70, 100):
        of = found.frame == frame
        assert found.joint[of].tolist() == [LEFT] * (frame in middle)
        if frame in middle:
            assert found.distance[of] == pytest.approx(middle[frame], abs=1e-5)
            np.testing.assert_allclose(found.point[of][0], partner[frame, RIGHT], atol=1e-6)


def test_a_hand_that_passes_is_not_held():
    passing = np.abs(np.arange(-30, 30)) / FPS * 3  # 3 m/s
    still = np.full(60, 0.15)
    counts = []
    for distances in (passing, still):
        partner, reaction = at_distances(distances)
        counts.append(len(predict_contacts(reaction, partner, FPS, SBU15, contact_model()).frame))
    assert counts[0] < 5
    assert counts[1] == 60


def test_a_contact_that_is_met_is_not_drawn_nearer_or_apart():
    partner, reaction = at_distances(np.full(30, 0.02))
    found = predict_contacts(reaction, partner, FPS, SBU15, contact_model())
    np.testing.assert_allclose(found.distance, 0.02, atol=1e-6)


def test_without_a_model_nothing_is_predicted():
    partner, reaction = at_distances(np.full(30, 0.01))
    assert not len(predict_contacts(reaction, partner, FPS, SBU15, no_contacts(SBU15)).frame)
    assert CONTACT_DISTANCE < MAX_DISTANCE
