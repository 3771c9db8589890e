"""Oracle: the minimum of the rule's quadratic energy, found by least squares."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.skeleton_prior.kinematics import KinematicOutput, find_limbs
from pacmo_core.skeleton_prior.start import initial_output, squared_distances, stand
from tests.skeleton_prior.examples import SMALL, START, generator, interaction

SETTINGS = replace(START, ground=5.0, contact=0.2, root=0.7, foot=2.0, hand=0.4, yielding=0.3)


def scene(seed: int = 0):
    """Draw a kinematic layer, templates (1, T, J, 3), scales and the partner's motion."""
    pair = interaction(seed)
    kinematics = KinematicOutput(SMALL, find_limbs(SMALL, pair.person_a))
    character, partner = (torch.from_numpy(m)[None, ::10] for m in (pair.person_a, pair.person_b))
    scales = 0.8 + 0.4 * torch.rand(1, len(SMALL.joints), generator=generator(seed))
    moved = partner + 0.1 * torch.randn(partner.shape, generator=generator(seed + 1))
    return kinematics, character, partner, scales, moved


def minimum(demands: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Minimise the sum of ``w |x - d|^2`` over x (3,), each coordinate with its own weights."""
    weights = np.array([w for w, _ in demands])
    return (weights * np.array([d for _, d in demands])).sum(axis=0) / weights.sum(axis=0)


def expected(scene, frame: int, share: float) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Compute the shift of the body and of each limb's end, demand by demand."""
    kinematics, character, partner, scales, moved = scene
    posture = kinematics.scaled_posture(character, scales)
    own, new, other, then = (
        x[0, frame].double().numpy() for x in (character, posture, partner, moved)
    )
    everywhere, up = np.ones(3), np.array([0.0, 1.0, 0.0])
    ends = [limb[2] for limb in kinematics.limbs.tolist()]
    contact = np.exp(
        -((np.linalg.norm(own[:, None] - other[None], axis=-1) / SETTINGS.contact_range) ** 2)
    )
    ground = np.exp(-(((own[:, 1] - own[ends, 1].min()) / SETTINGS.ground_height) ** 2))
    demands = [(SETTINGS.root * everywhere, np.zeros(3))]
    demands += [(SETTINGS.ground * ground[e] * up, own[e] - new[e]) for e in ends]

    def contacts(joints, weight, shift):
        return [
            (
                weight * share * contact[i, j] * everywhere,
                (then - other)[j] - (new - own)[i] - shift,
            )
            for i in joints
            for j in range(len(other))
        ]

    body = minimum(demands + contacts(range(len(own)), SETTINGS.contact, np.zeros(3)))
    limbs = {}
    for end in ends:
        beyond = np.flatnonzero(kinematics.ancestor_matrix[:, end].numpy())
        demands = [
            (everywhere, np.zeros(3)),
            (SETTINGS.foot * ground[end] * up, own[end] - new[end] - body),
        ]
        limbs[end] = body + minimum(demands + contacts(beyond, SETTINGS.hand, body))
    return body, limbs


@pytest.mark.parametrize("partner_yields", [True, False])
def test_the_start_is_the_minimum_of_its_demands(partner_yields):
    given = scene()
    kinematics, character, partner, scales, moved = given
    output = initial_output(
        kinematics,
        SETTINGS,
        (character, scales),
        (squared_distances(character, partner), moved - partner),
        partner_yields=partner_yields,
    )[0]
    share = SETTINGS.yielding if partner_yields else 1.0
    for frame in range(len(output)):
        body, limbs = expected(given, frame, share)
        np.testing.assert_allclose(output[frame, SMALL.root], body, atol=1e-5)
        for end, shift in limbs.items():
            np.testing.assert_allclose(output[frame, end], shift, atol=1e-5)
        others = set(range(len(SMALL.joints))) - {SMALL.root, *limbs}
        assert not output[frame, sorted(others)].any()


def test_nothing_moves_at_scale_one_beside_a_partner_who_does_not_move():
    kinematics, character, partner, scales, _ = scene()
    output = initial_output(
        kinematics,
        SETTINGS,
        (character, torch.ones_like(scales)),
        (squared_distances(character, partner), torch.zeros_like(partner)),
    )
    torch.testing.assert_close(output, torch.zeros_like(output), atol=1e-5, rtol=0)


def test_alone_a_taller_body_rises_to_keep_its_feet_at_their_height():
    kinematics, character, _, scales, _ = scene()
    feet = [end for _, _, end in kinematics.limbs.tolist() if "ankle" in SMALL.joints[end]]
    character = character - character[:, :, feet, 1].amin() * torch.tensor([0.0, 1.0, 0.0])
    character[:, :, feet, 1] = 0.0
    taller = torch.full_like(scales, 1.2)
    motion = stand(kinematics, replace(SETTINGS, ground=1e4), character, taller)
    rise = (motion - character)[:, :, SMALL.root]
    # The two legs' demands differ; their mean is met by the body.
    wanted = -(kinematics.scaled_posture(character, taller) - character)[:, :, feet, 1].mean(dim=2)
    torch.testing.assert_close(rise[..., 1], wanted, atol=1e-3, rtol=0)
    torch.testing.assert_close(rise[..., [0, 2]], torch.zeros_like(rise[..., [0, 2]]))
    assert (wanted > 0.05).all()
