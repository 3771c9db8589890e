"""Truth: a body that is its own mirror image, and bones of known lengths."""

import pytest
import torch

from pacmo_core.data.skeleton import SBU15
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.losses import ConstantBones, Symmetry
from pacmo_core.reaction.tensors import finite
from tests.reaction.problems import REST

TIMES = torch.linspace(0, 1, 9)
WEIGHTS = trapezoid_weights(TIMES)
BODY = torch.from_numpy(REST).float().flatten().expand(2, 9, 45)


def test_a_symmetric_body_is_not_penalised() -> None:
    assert Symmetry(SBU15)(BODY, WEIGHTS).item() < 1e-12


def test_a_forearm_that_grows_is_penalised_by_the_integral_of_its_square() -> None:
    joints = BODY.reshape(2, 9, 15, 3).clone()
    forearm = joints[0, 0, 5] - joints[0, 0, 4]
    joints[:, :, 5] += forearm / forearm.norm() * 0.1
    penalty = Symmetry(SBU15)(joints.flatten(2), WEIGHTS)
    assert penalty.item() == pytest.approx(0.01, rel=1e-4)


def test_bones_of_no_length_have_a_finite_gradient() -> None:
    motion = torch.zeros(1, 9, 45, requires_grad=True)
    (gradient,) = torch.autograd.grad(Symmetry(SBU15)(motion, WEIGHTS), motion)
    assert torch.isfinite(gradient).all()


def test_a_loss_that_is_no_number_is_refused_by_name() -> None:
    terms = {"distance": torch.tensor(1.0), "penalty": torch.tensor(float("nan"))}
    with pytest.raises(FloatingPointError, match="penalty not finite"):
        finite(terms, "adversarial")


def test_bones_that_keep_their_lengths_are_not_penalised_however_they_turn() -> None:
    angle = torch.linspace(0, 2, 9)
    turn = torch.zeros(9, 3, 3)
    turn[:, 0, 0], turn[:, 0, 2] = angle.cos(), angle.sin()
    turn[:, 2, 0], turn[:, 2, 2] = -angle.sin(), angle.cos()
    turn[:, 1, 1] = 1
    turned = BODY.reshape(2, 9, 15, 3) @ turn
    assert ConstantBones(SBU15)(turned.flatten(2), WEIGHTS).item() < 1e-10


def test_a_forearm_that_stretches_is_penalised_by_its_variance_over_time() -> None:
    # Length l0 + 0.1 cos(2 pi t): variance 0.1^2 / 2, exact for the trapezoid rule.
    joints = BODY.reshape(2, 9, 15, 3).clone()
    forearm = joints[0, 0, 5] - joints[0, 0, 4]
    wave = 0.1 * (2 * torch.pi * TIMES).cos()
    joints[:, :, 5] += wave[:, None] * forearm / forearm.norm()
    penalty = ConstantBones(SBU15)(joints.flatten(2), WEIGHTS)
    assert penalty.item() == pytest.approx(0.005, rel=1e-4)


def test_two_lengths_weigh_by_the_time_they_last() -> None:
    # 0.2 m longer for three of four quarters: variance 0.2^2 * 3 / 16.
    joints = BODY.reshape(2, 9, 15, 3).clone()
    foot = joints[0, 0, 11] - joints[0, 0, 10]
    times = torch.cat([torch.linspace(0, 0.25, 2), torch.linspace(0.25 + 1e-6, 1, 7)])
    joints[:, 2:, 11] += 0.2 * foot / foot.norm()
    penalty = ConstantBones(SBU15)(joints.flatten(2), trapezoid_weights(times))
    assert penalty.item() == pytest.approx(0.04 * 3 / 16, rel=1e-3)


def test_a_steady_body_of_no_size_has_a_finite_gradient() -> None:
    motion = torch.zeros(1, 9, 45, requires_grad=True)
    (gradient,) = torch.autograd.grad(ConstantBones(SBU15)(motion, WEIGHTS), motion)
    assert torch.isfinite(gradient).all()
