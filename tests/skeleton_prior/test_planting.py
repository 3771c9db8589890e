"""Oracle: a mean over each stretch of support, by hand."""

import numpy as np
import torch

from pacmo_core.skeleton_prior.inference import find_supports, retarget
from pacmo_core.skeleton_prior.kinematics import find_limbs
from pacmo_core.skeleton_prior.planting import planting_corrections
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.training import build_start
from tests.skeleton_prior.examples import SMALL, START, generator, interaction


def test_displacements_are_constant_while_a_limb_supports_and_continuous_between():
    moved = torch.randn(3, 12, 2, 2, generator=generator())
    supports = np.zeros((12, 2), dtype=bool)
    supports[2:5, 0] = supports[8:11, 0] = True
    corrections = planting_corrections(moved, supports)
    planted = moved + corrections
    for stretch in (slice(2, 5), slice(8, 11)):
        expected = moved[:, stretch, 0].mean(dim=1, keepdim=True).expand(-1, 3, -1)
        torch.testing.assert_close(planted[:, stretch, 0], expected)
    torch.testing.assert_close(corrections[:, 6, 0], corrections[:, [4, 8], 0].mean(dim=1))
    torch.testing.assert_close(corrections[:, 0], corrections[:, 2])
    assert not corrections[:, :, 1].any()  # never supports


def test_supporting_ankles_do_not_slide_on_another_body():
    source = interaction(n_frames=31)
    ankle = SMALL.joints.index("left_ankle")
    source.person_b[:, ankle] = source.person_b[0, ankle]  # stands still
    source.person_b[:, ankle, 1] = source.person_b[..., 1].min() - 0.01
    assert find_supports(source)[:, 1, ankle].all()
    limbs = find_limbs(SMALL, source.person_b)
    start = build_start(PriorConfig(SMALL, limbs, "kinematic", 16, 3, 30.0, START))
    scales = np.ones((1, 2, len(SMALL.bones)))
    scales[0, 1] = 0.97
    ((varied,),) = retarget(start, source, scales, samples=1, random=None)
    slid = np.ptp(varied.person_b[:, ankle][:, [0, 2]], axis=0)
    assert (slid < 1e-4).all()


def test_no_limb_end_sinks_below_the_sources_lowest_joint():
    source = interaction(n_frames=31)
    start = build_start(
        PriorConfig(SMALL, find_limbs(SMALL, source.person_b), "kinematic", 16, 3, 30.0, START)
    )
    output = torch.zeros(1, 31, len(SMALL.joints), 3)
    template = torch.from_numpy(source.person_b)[None]
    ankle = SMALL.joints.index("left_ankle")
    output[:, :, ankle, 1] = -5.0
    scales, never = torch.ones(1, len(SMALL.joints)), np.zeros((31, len(SMALL.joints)), dtype=bool)
    lifted = start.first.planted(output, template, scales, never)
    others = [joint for joint in range(len(SMALL.joints)) if joint != ankle]
    assert torch.equal(lifted[:, :, others], output[:, :, others])
    expected = template[..., 1].min() - template[:, :, ankle, 1]
    torch.testing.assert_close(lifted[:, :, ankle, 1], expected, atol=1e-5, rtol=0)
