"""Trusted as truth: figures that follow by hand from motions laid out on paper."""

import copy
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.data.interaction import Interaction, joint_distances, min_joint_distance
from pacmo_core.data.quality import QualityError, check_quality, limit_violations, measure_quality
from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.ntu import Ntu
from pacmo_core.formats.sbu import Sbu
from tests.strategies import LIMITS

REAL = Path(os.environ.get("PACMO_REAL_DATA", "../shared/data"))
N_FRAMES = 20


def two(apart=1.0, speed=0.5, n_frames=N_FRAMES):
    """One body and its copy ``apart`` metres beside it, both walking along z."""
    body = np.random.default_rng(0).normal(scale=0.3, size=(15, 3))
    times = np.arange(n_frames) / 10
    walk = np.zeros((n_frames, 1, 3))
    walk[:, 0, 2] = speed * times
    motion = (body + walk).astype(np.float32)
    return Interaction(SBU15, times, motion, motion + np.float32([apart, 0, 0]))


def of(interaction, stated_fps=None):
    return limit_violations(measure_quality(interaction, contact_distance=0.1), LIMITS, stated_fps)


def moved(interaction, frame, offset, joints=slice(None)):
    motion = interaction.person_b.copy()
    motion[frame, joints] += np.float32(offset)
    return replace(interaction, person_b=motion)


def test_a_steady_walk_has_its_own_figures():
    quality = measure_quality(two(), contact_distance=0.1)
    assert (quality.n_frames, quality.fps) == (N_FRAMES, pytest.approx(10))
    assert quality.rate_jitter == pytest.approx(0, abs=1e-9)
    assert quality.bone_length_variation == pytest.approx(0, abs=1e-6)
    assert quality.max_joint_speed == pytest.approx(0.5, rel=1e-4)
    assert quality.max_body_speed == pytest.approx(0.5, rel=1e-4)
    assert quality.person_distance == pytest.approx(1, rel=1e-5)
    check_quality(quality, LIMITS)


def test_figures_do_not_depend_on_who_is_who_and_contact_is_mutual():
    interaction = moved(two(apart=0.5), 3, [0.1, 0, 0])
    one = measure_quality(interaction, contact_distance=0.2)
    assert one == measure_quality(interaction.swapped(), contact_distance=0.2)
    there, back = joint_distances(interaction), joint_distances(interaction.swapped())
    np.testing.assert_allclose(there, back.transpose(0, 2, 1), rtol=1e-6)


def test_the_min_joint_distance_is_that_of_all_pairs():
    interaction = two(apart=0.4)
    slow = [
        min(float(np.linalg.norm(p - q)) for p in a for q in b)
        for a, b in zip(interaction.person_a, interaction.person_b, strict=True)
    ]
    np.testing.assert_allclose(min_joint_distance(interaction), slow, rtol=1e-5)
    np.testing.assert_allclose(joint_distances(interaction).min(axis=(1, 2)), slow, rtol=1e-5)


def test_contact_is_counted_in_frames():
    interaction = two(apart=9)
    interaction.person_b[:5, 5] = interaction.person_a[:5, 8] + np.float32([0, 0.05, 0])
    assert measure_quality(interaction, contact_distance=0.06).contact_share == 5 / N_FRAMES
    assert measure_quality(interaction, contact_distance=0.04).contact_share == 0


def test_bones_that_breathe_vary_by_the_deviation_of_their_scale():
    scale = 1 + 0.3 * np.where(np.arange(N_FRAMES) % 2, 1, -1)[:, None, None]
    still = two(speed=0)
    breathing = replace(still, person_b=(still.person_b * scale).astype(np.float32))
    assert measure_quality(breathing, contact_distance=0.1).bone_length_variation == pytest.approx(
        0.3
    )
    assert "bones change in length by 30%" in of(breathing)[0]


def test_a_body_that_jumps_and_a_joint_that_jumps_are_distinguished():
    body = " and ".join(of(moved(two(), slice(10, None), [1.0, 0, 0])))
    assert "a body jumps at 10.0 m/s (person b at 0.90 s)" in body
    assert "a joint" not in body
    joint = " and ".join(of(moved(two(), 10, [15.0, 0, 0], joints=[5])))
    assert "a joint jumps at 150.0 m/s (" in joint
    assert "a body" not in joint


@pytest.mark.parametrize("noise", [0, 0.005, 0.03])
def test_the_same_dancer_fitted_twice_is_no_pair(noise):
    interaction = two(apart=0)
    wobble = np.random.default_rng(1).normal(scale=noise, size=interaction.person_b.shape)
    # A fit differs from a fit by a constant too.
    twice = replace(interaction, person_b=interaction.person_b + (wobble + 0.01).astype(np.float32))
    assert any("the same body twice" in fault for fault in of(twice))


def test_few_frames_and_uneven_times_are_faults():
    assert of(two(n_frames=9)) == ["9 frames, wanted at least 10"]
    times = np.delete(np.arange(N_FRAMES + 1) / 10, 7)
    assert "deviate from their median by 100%" in of(replace(two(), times=times))[0]


def test_a_rate_against_the_files_own_times_is_a_fault():
    assert of(two(), stated_fps=10.1) == []
    assert "own times give 10 frames a second, wanted 12" in of(two(), stated_fps=12)[0]


def test_bones_without_length_are_left_out_and_a_body_of_none_is_refused():
    interaction = two()
    interaction.person_a[:, 0] = interaction.person_a[:, 1]
    assert of(interaction) == []
    point = replace(interaction, person_a=np.zeros_like(interaction.person_a))
    assert any("bones change in length by inf" in fault for fault in of(point))


def test_an_error_names_all_faults_and_crosses_processes():
    with pytest.raises(QualityError) as caught:
        check_quality(measure_quality(two(apart=0, n_frames=3), contact_distance=0.1), LIMITS)
    assert len(caught.value.violations) == 2
    rebuilt = copy.copy(caught.value)  # by __reduce__, as between worker processes
    assert (str(rebuilt), rebuilt.violations) == (str(caught.value), caught.value.violations)


@pytest.mark.skipif(not REAL.is_dir(), reason=f"no published files at {REAL}")
def test_published_captures_of_two_people_pass():
    ntu, sbu = Ntu(fps=30, max_gap=5, max_link_distance=0.3, min_visible_share=0.5), Sbu(fps=15)
    clips = [sbu.read(sequence) for sequence in sbu.find(REAL / "sbu")]
    clips += [ntu.read(sequence) for sequence in ntu.find(REAL / "ntu" / "two_person")]
    assert len(clips) == 283
    assert [of(reading.interaction) for reading in clips if of(reading.interaction)] == []
