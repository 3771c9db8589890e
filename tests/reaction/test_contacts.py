"""Truth: distances drawn from known distributions, whose quantiles are known."""

import numpy as np
import pytest

from pacmo_core.data.skeleton import SBU15
from pacmo_core.reaction.contacts import (
    GRID,
    MAX_DISTANCE,
    end_effector_groups,
    identity_map,
    learn_contact_map,
    nearest_joints,
    predict_contacts,
)
from tests.reaction.problems import REST

HAND = SBU15.joints.index("left_hand")
ENDS = list(SBU15.end_effectors)
HANDS = end_effector_groups(SBU15)[ENDS.index(HAND)]


def at_distances(distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a partner 5 m away but for the right hand, at distances from the reaction's left."""
    n = len(distances)
    reaction = np.tile(REST, (n, 1, 1)).astype(np.float32)
    partner = reaction + np.array([0, 0, 5], np.float32)
    partner[:, SBU15.joints.index("right_hand")] = reaction[:, HAND] + np.stack(
        [distances, 0 * distances, 0 * distances], axis=1
    )
    return partner, reaction


def test_mirror_images_share_a_group():
    groups = dict(zip([SBU15.joints[end] for end in ENDS], end_effector_groups(SBU15), strict=True))
    assert groups["left_hand"] == groups["right_hand"] != groups["left_foot"]
    assert len({*groups.values()}) == 3


def test_distances_are_those_of_a_loop():
    random = np.random.default_rng(0)
    first, second = random.standard_normal((2, 4, 15, 3)).astype(np.float32)
    joints, distances = nearest_joints(first, second, SBU15)
    for t in range(4):
        for e, end in enumerate(ENDS):
            gaps = [np.linalg.norm(first[t, end] - second[t, j]) for j in range(15)]
            assert joints[t, e] == np.argmin(gaps)
            assert distances[t, e] == pytest.approx(min(gaps), abs=1e-6)


def test_the_map_takes_quantiles_to_quantiles():
    # Uniform on [0, 0.4] and [0, 0.2]: each distance maps to half of it.
    random = np.random.default_rng(0)
    generated, captured = (random.uniform(0, top, 4000) for top in (0.4, 0.2))
    maps = learn_contact_map([at_distances(generated)], [at_distances(captured)], SBU15)
    # Both hands are pooled; the right one is always far, which halves both distributions alike.
    within = (GRID > 0.02) & (GRID < 0.38)
    np.testing.assert_allclose(maps[HANDS][within], GRID[within] / 2, atol=0.01)


def test_the_map_never_takes_a_distance_to_a_greater_one_and_ascends():
    random = np.random.default_rng(1)
    generated, captured = (random.uniform(0, top, 400) for top in (0.2, 0.4))
    maps = learn_contact_map([at_distances(generated)], [at_distances(captured)], SBU15)
    assert (maps <= GRID + 1e-12).all()
    assert (np.diff(maps, axis=1) >= 0).all()


def test_groups_that_are_seldom_near_keep_their_distances():
    far = at_distances(np.full(100, 2.0))
    near = at_distances(np.full(100, 0.05))
    np.testing.assert_array_equal(learn_contact_map([far], [near], SBU15), identity_map(SBU15))


def test_contacts_are_predicted_within_reach_only_and_weaken_towards_its_end():
    distances = np.array([0.1, 0.4, 0.46])
    partner, reaction = at_distances(distances)
    found = predict_contacts(reaction, partner, SBU15, identity_map(SBU15))
    own = found.joint == HAND
    assert set(found.frame[own]) == {0, 1}
    strength = [found.strength[own & (found.frame == t)].max() for t in (0, 1)]
    assert strength == pytest.approx([1.0, 0.5], abs=1e-5)
    assert found.distance.max() < MAX_DISTANCE
    np.testing.assert_allclose(found.distance[own & (found.frame == 0)], 0.1, atol=1e-6)
