"""What is trusted: a reaction dealt to its own partner stays as it is; the frame's definition."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.reaction.facing import dealt_to, seen_from_partner
from tests.strategies import make_interaction


def clip(seed: int, n_frames: int = 30, fps: float = 30) -> Interaction:
    return make_interaction(np.random.default_rng(seed), n_frames, NTU25, fps)


def test_the_partner_starts_at_the_origin():
    seen = seen_from_partner(clip(1))
    np.testing.assert_allclose(seen.person_a[0, NTU25.root], 0, atol=1e-6)


def test_distances_between_the_two_are_kept():
    before, after = clip(2), seen_from_partner(clip(2))
    np.testing.assert_allclose(
        np.linalg.norm(after.person_a - after.person_b, axis=-1),
        np.linalg.norm(before.person_a - before.person_b, axis=-1),
        atol=1e-5,
    )


def test_where_the_world_stands_does_not_matter():
    turn, shift = Rotation.from_euler("y", 1.1).as_matrix(), np.array([3.0, -1.0, 2.0])
    here = clip(3)
    there = replace(
        here,
        person_a=(here.person_a @ turn.T + shift).astype(np.float32),
        person_b=(here.person_b @ turn.T + shift).astype(np.float32),
    )
    np.testing.assert_allclose(
        seen_from_partner(there).person_b, seen_from_partner(here).person_b, atol=1e-5
    )


def test_dealing_a_reaction_to_its_own_partner_changes_nothing():
    own = clip(4)
    np.testing.assert_allclose(dealt_to(own, own).person_b, own.person_b, atol=1e-5)


def test_a_dealt_reaction_is_played_over_the_other_partners_duration():
    partner, other = clip(5, n_frames=40, fps=15), clip(6, n_frames=20)
    dealt = dealt_to(partner, other)
    assert dealt.person_a is partner.person_a
    np.testing.assert_allclose(dealt.person_b[0], other.person_b[0], atol=1e-6)
    np.testing.assert_allclose(dealt.person_b[-1], other.person_b[-1], atol=1e-6)
