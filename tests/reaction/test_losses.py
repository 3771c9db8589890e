"""Truth: a body that is its own mirror image, and bones of known lengths."""

from dataclasses import replace

import pytest
import torch

from pacmo_core.data.skeleton import SBU15
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction import wgan
from pacmo_core.reaction.losses import BoneLengthPenalty, BoneSymmetryPenalty
from pacmo_core.reaction.wgan import WganTrainer
from pacmo_core.training.state import model_state
from tests.reaction.problems import PACMO, REST, clips

TIMES = torch.linspace(0, 1, 9)
WEIGHTS = trapezoid_weights(TIMES)
BODY = torch.from_numpy(REST).float().flatten().expand(2, 9, 45)


def test_a_symmetric_body_is_not_penalised() -> None:
    assert BoneSymmetryPenalty(SBU15)(BODY, WEIGHTS).item() < 1e-12


def test_a_forearm_that_grows_is_penalised_by_the_integral_of_its_square() -> None:
    joints = BODY.reshape(2, 9, 15, 3).clone()
    forearm = joints[0, 0, 5] - joints[0, 0, 4]
    joints[:, :, 5] += forearm / forearm.norm() * 0.1
    penalty = BoneSymmetryPenalty(SBU15)(joints.flatten(2), WEIGHTS)
    assert penalty.item() == pytest.approx(0.01, rel=1e-4)


def test_bones_of_no_length_have_a_finite_gradient() -> None:
    motion = torch.zeros(1, 9, 45, requires_grad=True)
    (gradient,) = torch.autograd.grad(BoneSymmetryPenalty(SBU15)(motion, WEIGHTS), motion)
    assert torch.isfinite(gradient).all()


def test_bones_that_keep_their_lengths_are_not_penalised_however_they_turn() -> None:
    angle = torch.linspace(0, 2, 9)
    turn = torch.zeros(9, 3, 3)
    turn[:, 0, 0], turn[:, 0, 2] = angle.cos(), angle.sin()
    turn[:, 2, 0], turn[:, 2, 2] = -angle.sin(), angle.cos()
    turn[:, 1, 1] = 1
    turned = BODY.reshape(2, 9, 15, 3) @ turn
    assert BoneLengthPenalty(SBU15)(turned.flatten(2), WEIGHTS).item() < 1e-10


def test_a_forearm_that_stretches_is_penalised_by_its_variance_over_time() -> None:
    # Length l0 + 0.1 cos(2 pi t): variance 0.1^2 / 2, exact for the trapezoid rule.
    joints = BODY.reshape(2, 9, 15, 3).clone()
    forearm = joints[0, 0, 5] - joints[0, 0, 4]
    wave = 0.1 * (2 * torch.pi * TIMES).cos()
    joints[:, :, 5] += wave[:, None] * forearm / forearm.norm()
    penalty = BoneLengthPenalty(SBU15)(joints.flatten(2), WEIGHTS)
    assert penalty.item() == pytest.approx(0.005, rel=1e-4)


def test_two_lengths_weigh_by_the_time_they_last() -> None:
    # 0.2 m longer for three of four quarters: variance 0.2^2 * 3 / 16.
    joints = BODY.reshape(2, 9, 15, 3).clone()
    foot = joints[0, 0, 11] - joints[0, 0, 10]
    times = torch.cat([torch.linspace(0, 0.25, 2), torch.linspace(0.25 + 1e-6, 1, 7)])
    joints[:, 2:, 11] += 0.2 * foot / foot.norm()
    penalty = BoneLengthPenalty(SBU15)(joints.flatten(2), trapezoid_weights(times))
    assert penalty.item() == pytest.approx(0.04 * 3 / 16, rel=1e-3)


def test_a_steady_body_of_no_size_has_a_finite_gradient() -> None:
    motion = torch.zeros(1, 9, 45, requires_grad=True)
    (gradient,) = torch.autograd.grad(BoneLengthPenalty(SBU15)(motion, WEIGHTS), motion)
    assert torch.isfinite(gradient).all()


def wgan_trainer(**changes: object) -> WganTrainer:
    found = wgan.build_training(clips(8), replace(PACMO, **changes)).trainer
    assert isinstance(found, WganTrainer)
    return found


def test_on_a_cpu_precision_and_compiling_change_no_bit() -> None:
    plain, asked = (
        wgan.build_training(clips(8), settings).finish()
        for settings in (PACMO, replace(PACMO, mixed_precision=True, compile_generator=True))
    )
    assert all(
        torch.equal(value, model_state(asked)[name]) for name, value in model_state(plain).items()
    )


def test_reduced_precision_leaves_the_penalty_alone_and_hardly_moves_the_losses() -> None:
    parts = wgan_trainer()
    batch = parts._sample_batch(for_critic=True)
    whole, whole_terms = parts.losses.critic_loss(batch)
    # autocast works on a CPU too; the setting alone asks for a GPU.
    parts.losses._mixed_precision = True
    reduced, terms = parts.losses.critic_loss(batch)
    made, _ = parts.losses.generator_loss(parts._sample_batch(for_critic=False), use_critic=True)
    assert reduced.dtype == made.dtype == torch.float32
    assert parts.losses.generate(batch).dtype == torch.float32
    distance = "wasserstein_distance"
    assert terms[distance].item() != whole_terms[distance].item()
    assert reduced.item() == pytest.approx(whole.item(), rel=1e-3)
    torch.testing.assert_close(
        terms["gradient_penalty"], whole_terms["gradient_penalty"], rtol=1e-3, atol=0
    )


def test_a_weight_on_constant_bones_is_a_term_and_moves_the_loss() -> None:
    plain, weighed = wgan_trainer(), wgan_trainer(bone_length_weight=3.0)
    (loss, _), (more, terms) = (
        parts.losses.generator_loss(parts._sample_batch(for_critic=False), use_critic=True)
        for parts in (plain, weighed)
    )
    assert more.item() == pytest.approx(
        loss.item() + 3 * terms["bone_length_variance"].item(), rel=1e-5
    )


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")
def test_a_gpu_trains_in_reduced_precision_with_a_compiled_generator() -> None:
    settings = replace(PACMO, mixed_precision=True, compile_generator=True)
    fit = wgan.build_training(clips(8), settings, validation=clips(3, first_seed=90), device="cuda")
    curve = list(fit)
    assert len(curve) == PACMO.n_epochs
    assert all(value.is_cuda for value in fit.model.state_dict().values())
