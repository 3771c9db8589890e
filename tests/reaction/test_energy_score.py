"""Truth: distributions of one number, whose scores are integrals, and the definition in full."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.data.skeleton import SBU15
from pacmo_core.operators.quadrature import trapezoid_weights
from pacmo_core.reaction.data import MotionPairs
from pacmo_core.reaction.energy_score import (
    ACCELERATION_SCALE,
    BONE_SCALE,
    HEIGHT_SCALE,
    INSTANT_WEIGHT,
    SPEED_SCALE,
    TRUNK_SCALE,
    ContactScore,
    EnergyScore,
    energy_score,
)
from pacmo_core.reaction.settings import ContactScoreSettings
from tests.reaction.problems import REST

WEIGHTS = trapezoid_weights(torch.linspace(0, 1, 5))


def constant(values: torch.Tensor) -> torch.Tensor:
    """Functions of time that do not change, of norm |value|."""
    return values[..., None, None].expand(*values.shape, 5, 1)


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(2, 6), st.integers(0, 1000))
def test_it_is_its_definition_written_out(n_samples, seed):
    random = torch.Generator().manual_seed(seed)
    samples = torch.randn(n_samples, 2, 5, 3, generator=random)
    truth = torch.randn(2, 5, 3, generator=random)

    def norm(a):
        return math.sqrt(sum(float(w) * float(a[t].square().mean()) for t, w in enumerate(WEIGHTS)))

    for row, found in enumerate(energy_score(samples, truth, WEIGHTS)):
        errors = [norm(s[row] - truth[row]) for s in samples]
        apart = [
            norm(samples[k, row] - samples[other, row])
            for k in range(n_samples)
            for other in range(k + 1, n_samples)
        ]
        expected = sum(errors) / n_samples - sum(apart) / (n_samples * (n_samples - 1))
        assert float(found) == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_samples_of_the_true_distribution_score_what_the_closed_form_says():
    # E|X - u| = 2 / sqrt(pi) for two standard normals; less half of it.
    random = torch.Generator().manual_seed(0)
    samples, truth = (torch.randn(n, 20000, generator=random) for n in (4, 1))
    found = energy_score(constant(samples), constant(truth[0]), WEIGHTS).mean()
    assert float(found) == pytest.approx(1 / math.sqrt(math.pi), abs=0.02)


@pytest.mark.parametrize("spread", [0.0, 0.5, 2.0])
def test_the_true_distribution_scores_better_than_one_too_narrow_or_too_wide(spread):
    random = torch.Generator().manual_seed(1)
    samples, truth = (torch.randn(n, 20000, generator=random) for n in (4, 1))
    right, wrong = (
        energy_score(constant(scale * samples), constant(truth[0]), WEIGHTS).mean()
        for scale in (1.0, spread)
    )
    assert right < wrong


def test_the_right_partners_score_better_than_others():
    random = torch.Generator().manual_seed(2)
    partner = torch.randn(5000, generator=random)
    samples = partner + 0.5 * torch.randn(4, 5000, generator=random)
    truth = constant(partner + 0.5 * torch.randn(5000, generator=random))
    right = energy_score(constant(samples), truth, WEIGHTS).mean()
    assert right < 0.6 * energy_score(constant(samples.roll(1, dims=1)), truth, WEIGHTS).mean()


def test_one_sample_is_refused():
    with pytest.raises(ValueError, match="at least 2 samples; got 1"):
        energy_score(torch.zeros(1, 2, 5, 1), torch.zeros(2, 5, 1), WEIGHTS)


def test_the_score_of_a_motion_is_the_mean_of_its_views():
    # One joint of fifteen is off by d, in one sample; the truth and the other sample stand still.
    d = 0.3
    truth = torch.from_numpy(REST).float().flatten().expand(1, 5, 45)
    off = truth.clone()
    off[..., 5 * 3 + 1] += d  # a hand: a leaf, so one bone changes, and its place in the pose
    samples = torch.stack([off, truth])
    # |X - u| averages d' / 2 over the samples, less half of |X - X'| = d': nothing but round-off.
    assert float(EnergyScore(SBU15)(samples, truth, WEIGHTS)) == pytest.approx(0, abs=1e-3)
    both = EnergyScore(SBU15)(torch.stack([off, off]), truth, WEIGHTS)
    # Whole motion and pose: d / sqrt(45); bones: 2 d / sqrt(42); the hand, one of five ends:
    # d / sqrt(3); path and speeds do not change. At each instant both hands: d / sqrt(6).
    expected = (2 * d / 45**0.5 + 2 * d / 42**0.5 + d / 3**0.5 / 5) / 7
    expected += INSTANT_WEIGHT * d / 6**0.5
    assert float(both) == pytest.approx(expected, rel=2e-3)


def test_a_motion_that_shivers_scores_worse_though_it_is_as_near():
    steady = torch.zeros(2, 1, 5, 45)
    shivering = steady.clone()
    steady += 0.1
    shivering += 0.1 * torch.tensor([1.0, -1.0, 1.0, -1.0, 1.0])[:, None]
    score = EnergyScore(SBU15)
    truth = torch.zeros(1, 5, 45)
    assert float(score(shivering, truth, WEIGHTS)) > 1.2 * float(score(steady, truth, WEIGHTS))


CONTACT = ContactScore(
    SBU15,
    ContactScoreSettings(
        near_weight=0.5,
        near_distance=0.1,
        log_distance_weight=0.25,
        approach_weight=1.0,
        stance_weight=2.0,
        stance_speed=0.3,
        spread=1.0,
    ),
)


def still(offset: float, step: float = 0.0) -> torch.Tensor:
    """Return a body that stands, ``offset`` metres ahead, and moves by ``step`` in the clip."""
    body = torch.from_numpy(REST).float().expand(1, 5, 15, 3).clone()
    body[..., 2] += offset + step * torch.linspace(0, 1, 5)[:, None]
    return body.flatten(2)


def pair(reaction: torch.Tensor, seconds: float = 2.0) -> MotionPairs:
    duration = torch.tensor([seconds]).log()
    return MotionPairs(still(1.0), reaction, duration, torch.zeros(1, dtype=torch.long))


def test_contact_scores_are_those_of_the_functions_written_out():
    truth, samples = still(0.0), torch.stack([still(0.9), still(0.6)])
    found = CONTACT(samples, pair(truth), WEIGHTS)
    ends = {i for i in range(15) if i not in SBU15.parents}
    functions = {"near": {}, "log_distance": {}}
    for name, body in (("u", still(0.0)), ("a", samples[0]), ("b", samples[1])):
        joints, partner = (m[0, 0].view(15, 3).double().numpy() for m in (body, still(1.0)))
        distances = np.array(
            [
                math.sqrt(((joints[i] - partner[j]) ** 2).sum() + 0.02**2)
                for i in range(15)
                for j in range(15)
                if i in ends or j in ends
            ]
        )
        functions["near"][name] = np.exp(-distances / 0.1)
        # The mean over pairs: the sum over their number.
        functions["log_distance"][name] = np.log(distances + 0.05) / len(distances) ** 0.5
    for name, values in functions.items():
        apart = {k: np.linalg.norm(values[k[0]] - values[k[1]]) for k in ("au", "bu", "ab")}
        expected = (apart["au"] + apart["bu"]) / 2 - apart["ab"] / 2
        assert float(found[name]) == pytest.approx(expected, rel=2e-3)


def test_the_approach_of_a_blow_is_as_near_as_its_nearest_instant():
    # The partner's hand comes for one instant of five, in the captured motion nearer by 20 cm.
    hand, middle = SBU15.joints.index("left_hand"), 2
    partner = still(3.0)
    reactions = []
    for gap in (0.1, 0.3):
        motion = still(0.0)
        motion.view(1, 5, 15, 3)[0, middle, hand] = partner.view(1, 5, 15, 3)[0, middle, hand]
        motion.view(1, 5, 15, 3)[0, middle, hand, 2] -= gap
        reactions.append(motion)
    real = replace(pair(reactions[0]), partner=partner)
    found = CONTACT(torch.stack([reactions[1]] * 2), real, WEIGHTS)["approach"]

    def least(motion: torch.Tensor) -> np.ndarray:
        joints, other = (m.view(5, 15, 3).double().numpy() for m in (motion, partner))
        apart = np.linalg.norm(joints[:, :, None] - other[:, None], axis=-1)
        ends = list(SBU15.end_effectors)
        of_each = [apart[:, ends].min(axis=(0, 2)), apart[:, :, ends].min(axis=(0, 1))]
        return np.log(np.sqrt(np.concatenate(of_each) ** 2 + 0.02**2) + 0.05)

    expected = np.sqrt(np.square(least(reactions[1]) - least(reactions[0])).mean())
    assert float(found) == pytest.approx(expected, rel=1e-3)


def test_the_stance_score_sees_the_speed_of_feet_in_metres_per_second():
    truth, samples = still(0.0), torch.stack([still(0.0, step=0.6)] * 2)
    for seconds in (1.0, 2.0):
        found = CONTACT(samples, pair(truth, seconds), WEIGHTS)
        expected = 1 - math.exp(-0.6 / seconds / 0.3)
        assert float(found["stance"]) == pytest.approx(expected, rel=5e-3)


def test_a_hand_that_misses_scores_worse_by_contact_than_by_the_motion():
    # The hand of one of two samples is 15 cm off: as much of the motion, whether at the partner's.
    truth = still(0.97)
    near, far = (truth.clone(), truth.clone())
    near.view(1, 5, 15, 3)[..., 5, 0] += 0.15  # a hand at the partner's side
    score = CONTACT(torch.stack([near, near]), pair(truth), WEIGHTS)
    assert float(score["near"]) > 5 * float(
        EnergyScore(SBU15)(torch.stack([near, near]), truth, WEIGHTS)
    )
    same = CONTACT(torch.stack([far, far]), pair(truth), WEIGHTS)
    assert max(float(value) for value in same.values()) < 1e-3


def test_the_total_weighs_the_scores():
    scores = dict.fromkeys(("near", "log_distance", "approach", "stance"), torch.ones(3))
    torch.testing.assert_close(CONTACT.total(scores), torch.full((3,), 3.75))


def test_bodies_in_one_place_have_a_finite_gradient():
    samples = torch.stack([still(1.0), still(1.0)]).requires_grad_()
    total = CONTACT.total(CONTACT(samples, pair(still(1.0)), WEIGHTS)).sum()
    (gradient,) = torch.autograd.grad(total, samples)
    assert torch.isfinite(gradient).all()


def test_feet_hands_and_vectors_across_the_body_are_scored_at_each_instant():
    # A foot that moves evenly by d over the clip in both samples, where the captured one stands.
    d = 0.3
    truth = torch.from_numpy(REST).float().flatten().expand(1, 5, 45)
    score = EnergyScore(SBU15)
    scores = []
    for joint in (SBU15.joints.index("left_foot"), SBU15.joints.index("left_hip")):
        moved = truth.clone()
        moved[..., 3 * joint] += d * torch.linspace(0, 1, 5)
        views = zip(score._instant_views(moved), score._instant_views(truth), strict=True)
        norms = [(a - b).square().mean(dim=(-1, -2)).sqrt()[0] for a, b in views]
        scores.append([float(norm @ WEIGHTS) for norm in norms])
    speed = SPEED_SCALE * d / 6**0.5  # six channels, three of each foot
    place = d / 6**0.5 / 2  # a half of d on average
    width = BONE_SCALE * d / 3**0.5 / 2
    # Velocities of feet; places of hands and of feet; from foot to foot; shoulders and hips.
    assert scores[0][:6] == pytest.approx([speed, 0, place, width, 0, 0], abs=1e-6)
    assert scores[1][:6] == pytest.approx([0, 0, 0, 0, 0, width], abs=1e-6)


def test_a_body_that_sinks_and_folds_for_an_instant_is_seen_in_height_trunk_and_acceleration():
    d, middle = 0.2, 2
    truth = torch.from_numpy(REST).float().expand(1, 5, 15, 3)
    score = EnergyScore(SBU15)
    sinks, folds = truth.clone(), truth.clone()
    sinks[:, middle, :, 1] -= d
    for pair in score.trunk_pairs[:1]:  # the shoulders, which lean ahead
        folds[:, middle, pair, 2] += d
    norms = []
    for motion in (sinks, folds):
        views = zip(
            score._instant_views(motion.flatten(2)),
            score._instant_views(truth.flatten(2)),
            strict=True,
        )
        errors = [(a - b).square().mean(dim=(-1, -2)).sqrt()[0] for a, b in views]
        norms.append([error.tolist() for error in errors[6:]])
    height, *trunk, acceleration = norms[0]
    assert height == pytest.approx([0, 0, HEIGHT_SCALE * d, 0, 0], abs=1e-5)
    assert max(map(max, trunk)) < 1e-5
    # Second differences d, -2 d, d of three points' heights: three of nine channels; four steps.
    bend = ACCELERATION_SCALE * 16 * d / 3**0.5
    assert acceleration == pytest.approx([0, bend, 2 * bend, bend, 0], rel=1e-4, abs=1e-5)
    height, shoulders, hips, _ = norms[1]
    assert max(height + hips) < 1e-5
    assert shoulders == pytest.approx([0, 0, TRUNK_SCALE * d / 3**0.5, 0, 0], rel=1e-4, abs=1e-5)


def test_gaits_out_of_step_score_better_than_their_mean_that_glides():
    random = torch.Generator().manual_seed(3)
    times, n = torch.linspace(0, 1, 33), 400
    weights = trapezoid_weights(times)
    feet = [SBU15.joints.index(name) for name in ("left_foot", "right_foot")]
    hand = SBU15.joints.index("left_hand")

    def walks(phase: torch.Tensor) -> torch.Tensor:
        """Feet that stand and swing by turns, of phase ``(N,)`` of a cycle; a hand anywhere."""
        body = torch.from_numpy(REST).float().expand(len(phase), 33, 15, 3).clone()
        for number, foot in enumerate(feet):
            cycle = 3 * times + phase[:, None] + number / 2
            body[:, :, foot, 2] += 0.5 * (cycle - (2 * math.pi * cycle).sin() / (2 * math.pi))
        body[:, :, hand] += torch.randn(len(phase), 1, 3, generator=random)
        return body.flatten(2)

    truth = walks(torch.rand(n, generator=random))
    gaits = torch.stack([walks(torch.rand(n, generator=random)) for _ in range(4)])
    glide = gaits.clone()
    for foot in feet:
        channels = slice(3 * foot, 3 * foot + 3)
        glide[..., channels] = truth[..., channels].mean(dim=0)

    def ratio(score: Callable[[torch.Tensor], torch.Tensor]) -> float:
        return float(score(glide).mean() / score(gaits).mean())

    score = EnergyScore(SBU15)
    whole = ratio(lambda motion: energy_score(motion, truth, weights))
    assert 1 < whole < 1.1  # proper, but hardly seen
    one = torch.ones(1)
    instants = ratio(
        lambda motion: (
            energy_score(score._instant_views(motion)[0], score._instant_views(truth)[0], one)
            @ weights
        )
    )
    assert instants > 1.4
