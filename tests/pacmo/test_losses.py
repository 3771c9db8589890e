"""Truth: a body that is its own mirror image, and bones of known lengths."""

import pytest
import torch

from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.pacmo.losses import Symmetry, finite
from pacmo_core.skeleton import SBU15
from tests.pacmo.problems import REST

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
