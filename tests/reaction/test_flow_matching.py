"""Truth: flows between Gaussian processes, whose velocities are linear and known.

From N(0, C_0) to N(m, C_1) the path ``X_s = (1 - s) X_0 + s X_1`` is Gaussian with covariance
``S = (1 - s)^2 C_0 + s^2 C_1``. Given it the velocity ``X_1 - X_0`` has the mean ``m + (s C_1 -
(1 - s) C_0) S^-1 (X_s - s m)`` and the covariance ``C_0 S^-1 C_1``.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from pacmo_core.data.interaction import Interaction
from pacmo_core.operators.random_field import GaussianRandomField
from pacmo_core.reaction import flow_matching
from pacmo_core.reaction.data import sample_motion_pairs
from pacmo_core.reaction.flow_matching import (
    FlowGenerator,
    FlowLoss,
    flow_times,
    integrate,
    prediction_error,
)
from pacmo_core.reaction.inference import finish_reactions, react, react_all
from pacmo_core.reaction.stream import ReactionStream
from pacmo_core.reaction.windows import PartnerMotion, is_deterministic
from tests.reaction.problems import FLOW_MATCHING, clips, delayed_mirror

TIMES = torch.linspace(0, 1, 9, dtype=torch.float64)
MEAN = (3 * TIMES).sin()


def covariance(tau: float, variance: float) -> Tensor:
    """Return that of a random field and of a constant at ``TIMES``, of full rank."""
    field = GaussianRandomField(alpha=2.0, tau=tau, n_frequencies=16, period=1.25)
    lag = TIMES[:, None] - TIMES
    angle = 2 * math.pi / field.period * torch.arange(1, 17, dtype=torch.float64)
    periodic = ((angle * lag[..., None]).cos() * field.power()).sum(dim=-1)
    return variance * (periodic + 0.5 + 0.1 * torch.eye(len(TIMES)))


START, END = covariance(5.0, 1.0), covariance(12.0, 0.3)


def path_covariance(s: float) -> Tensor:
    return (1 - s) ** 2 * START + s**2 * END


def velocity(state: Tensor, flow_time: Tensor) -> Tensor:
    """Apply the known velocity to ``(B, T, 1)`` states at one flow time."""
    s = float(flow_time.flatten()[0])
    linear = (s * END - (1 - s) * START) @ path_covariance(s).inverse()
    return MEAN[:, None] + linear @ (state - s * MEAN[:, None])


def predict_end(state: Tensor, flow_time: Tensor) -> Tensor:
    return state + (1 - flow_time) * velocity(state, flow_time)


def sampled(n: int, covariance: Tensor, random: torch.Generator) -> Tensor:
    normal = torch.randn(n, len(TIMES), 1, generator=random, dtype=torch.float64)
    return torch.linalg.cholesky(covariance) @ normal


@pytest.mark.parametrize(("n_steps", "tolerance"), [(100, 4e-2), (400, 1e-2)])
def test_the_known_velocity_carries_a_gaussian_process_to_another(
    n_steps: int, tolerance: float
) -> None:
    zero = torch.zeros(1, len(TIMES), 1, dtype=torch.float64)
    mean = integrate(predict_end, zero, n_steps)
    # The flow is affine: its linear part is seen on unit vectors.
    units = torch.eye(len(TIMES), dtype=torch.float64)[..., None]
    flow = (integrate(predict_end, units, n_steps) - mean)[..., 0].T
    found = flow @ START @ flow.T
    assert (mean[0, :, 0] - MEAN).abs().max() < tolerance
    assert (found - END).norm() < tolerance * END.norm()


@pytest.mark.parametrize("s", [0.0, 0.3, 0.9])
def test_the_least_error_of_the_velocity_is_its_conditional_covariance(s: float) -> None:
    random = torch.Generator().manual_seed(0)
    n = 40_000
    start, end = sampled(n, START, random), sampled(n, END, random) + MEAN[:, None]
    now = torch.full((n, 1, 1), s, dtype=torch.float64)
    # The error of the velocity is that of the prediction over 1 - s.
    error = prediction_error(predict_end, start, end, now)[..., 0] / (1 - s)
    expected = START @ path_covariance(s).inverse() @ END
    assert (error.T @ error / n - expected).norm() < 0.03 * expected.norm()
    assert error.mean(dim=0).abs().max() < 0.02


def test_flow_times_go_from_0_to_1_and_are_dense_at_both_ends() -> None:
    times = flow_times(torch.linspace(0, 1, 9))
    torch.testing.assert_close(times[[0, 4, 8]], torch.tensor([0.0, 0.5, 1.0]))
    steps = times.diff()
    assert (steps > 0).all()
    torch.testing.assert_close(steps, steps.flip(0))
    assert steps[0] < steps[1] < steps[3]


@pytest.fixture(scope="module")
def trained() -> FlowGenerator:
    return flow_matching.build_training(clips(16), FLOW_MATCHING).finish()


def partner(times: np.ndarray) -> Interaction:
    return delayed_mirror(7, times)


def reacted(model: FlowGenerator, seen: Interaction, at: np.ndarray, seed: int = 3) -> np.ndarray:
    random = torch.Generator().manual_seed(seed)
    return react(model, seen.person_a, seen.times, out_times=at, n_samples=2, random=random)


COMMON = np.linspace(0, 2, 21)


@pytest.mark.parametrize("n_steps", [1, 2, 5])
def test_a_flow_whose_end_is_known_arrives_there_in_any_number_of_steps(n_steps: int) -> None:
    end = torch.randn(3, 9, 2, generator=torch.Generator().manual_seed(0))
    found = integrate(lambda state, now: end, torch.zeros_like(end), n_steps)
    torch.testing.assert_close(found, end)


def test_an_operator_that_adds_nothing_leaves_a_field_that_has_arrived() -> None:
    """Then reactions are predicted as if they were distributed as the field, which stays itself."""
    model = flow_matching.build_training(clips(8), replace(FLOW_MATCHING, n_steps=400)).model
    with torch.no_grad():
        model.uno.head[-1].weight.zero_()
        model.uno.head[-1].bias.zero_()
        noise = model.sample_noise(2, torch.Generator().manual_seed(1))
        found = model(noise, sample_motion_pairs(clips(2), 17).condition)
    field = model.config.noise.evaluate(noise, model.points)
    found = model.normalisation.normalise_reaction(found)
    assert (found - field).norm() < 0.02 * field.norm()


def test_a_reaction_is_the_integral_of_the_operators_predictions(trained: FlowGenerator) -> None:
    condition = sample_motion_pairs(clips(3), 17).condition
    noise = trained.sample_noise(3, torch.Generator().manual_seed(1))
    with torch.no_grad():
        end = integrate(
            lambda state, now: trained.predict_end(state, now, condition),
            trained.config.noise.evaluate(noise, trained.points),
            trained.config.n_steps,
        )
        found = trained(noise, condition)
    torch.testing.assert_close(found, trained.normalisation.denormalise_reaction(end))


def test_the_loss_of_predictions_that_are_shifted_as_a_whole_is_known(
    trained: FlowGenerator, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = sample_motion_pairs(clips(4), 17)
    end = trained.normalisation.normalise_reaction(pairs.reaction)
    loss, random = FlowLoss(trained), torch.Generator().manual_seed(0)
    for shift in (0.0, 0.3):
        monkeypatch.setattr(trained, "predict_end", lambda *_, d=shift: end + d)
        # Of the five views the whole motion and the root's path are shifted.
        assert float(loss(pairs, random)) == pytest.approx(2 / 5 * shift**2, abs=1e-7)


def test_the_field_has_the_covariance_of_the_reactions_channels() -> None:
    scale = 0.7
    model = flow_matching.build_training(clips(16), replace(FLOW_MATCHING, noise_scale=scale)).model
    pairs = sample_motion_pairs(clips(16), 17)
    reactions = model.normalisation.normalise_reaction(pairs.reaction).flatten(0, 1)
    noise = model.sample_noise(4000, torch.Generator().manual_seed(0))
    at = model.config.noise.evaluate(noise, model.points[[3]])[:, 0]
    expected = scale**2 * reactions.T @ reactions / len(reactions)
    assert (at.T @ at / len(at) - expected).norm() < 0.05 * expected.norm()


def test_the_reaction_at_30_and_at_120_frames_a_second_is_one_function(
    trained: FlowGenerator,
) -> None:
    seen = partner(np.linspace(0, 2, 61))
    slow, fast = (reacted(trained, seen, np.linspace(0, 2, n)) for n in (61, 241))
    np.testing.assert_allclose(fast[:, ::4], slow, atol=1e-5)


@pytest.mark.parametrize("n_frames", [257, 513])
def test_the_reaction_does_not_depend_on_how_the_partner_was_sampled(
    trained: FlowGenerator, n_frames: int
) -> None:
    base, other = (reacted(trained, partner(np.linspace(0, 2, n)), COMMON) for n in (129, n_frames))
    assert np.linalg.norm(base - other) <= 1e-3 * np.linalg.norm(base)


def test_partners_of_any_lengths_in_one_batch_react_as_if_alone(trained: FlowGenerator) -> None:
    partners = [PartnerMotion(c.person_a, c.times, c.times) for c in clips(5, first_seed=20)]
    together = react_all(trained, partners, n_samples=2, random=torch.Generator().manual_seed(0))
    random = torch.Generator().manual_seed(0)
    for one, motion in zip(partners, together, strict=True):
        (alone,) = react_all(trained, [one], n_samples=2, random=random)
        np.testing.assert_allclose(motion, alone, atol=1e-5)


def test_a_seed_repeats_its_samples_byte_for_byte_and_another_gives_others(
    trained: FlowGenerator,
) -> None:
    assert not is_deterministic(trained)
    seen = partner(np.linspace(0, 2, 61))
    first = reacted(trained, seen, COMMON)
    assert first.tobytes() == reacted(trained, seen, COMMON).tobytes()
    assert np.abs(first - reacted(trained, seen, COMMON, seed=4)).max() > 1e-4
    assert np.abs(first[0] - first[1]).max() > 1e-4


def test_reactions_are_finished_and_streamed_as_those_of_other_models(
    trained: FlowGenerator,
) -> None:
    seen = partner(np.linspace(0, 2, 61))
    motion = PartnerMotion(seen.person_a, seen.times, seen.times)
    finished = finish_reactions(trained, motion, reacted(trained, seen, seen.times))
    bones = seen.skeleton.bones
    lengths = np.linalg.norm(finished[:, :, bones[:, 1]] - finished[:, :, bones[:, 0]], axis=-1)
    assert np.ptp(lengths, axis=1).max() < 1e-3
    stream = ReactionStream(trained, n_samples=2, random=torch.Generator().manual_seed(3))
    poses = [stream.react(seen.person_a[k], float(seen.times[k])) for k in range(3)]
    assert all(pose.shape == (2, 15, 3) and np.isfinite(pose).all() for pose in poses)


def test_a_flow_in_no_steps_or_from_another_field_is_refused(trained: FlowGenerator) -> None:
    with pytest.raises(ValueError, match="n_steps must be at least 1; got 0"):
        replace(FLOW_MATCHING, n_steps=0)
    with pytest.raises(ValueError, match="noise_scale must be greater than 0; got 0"):
        replace(FLOW_MATCHING, noise_scale=0.0)
    with pytest.raises(ValueError, match="45 channels of the field; got 0 and 45"):
        replace(trained.config, n_steps=0)


@pytest.mark.slow
def test_the_flow_learns_to_follow_its_partner() -> None:
    fitted = flow_matching.build_training(
        clips(32), FLOW_MATCHING, validation=clips(8, first_seed=50)
    )
    curve = list(fitted)
    assert curve[-1]["validation"] < 0.6 * curve[0]["loss"]
