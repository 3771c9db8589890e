"""Truth: closed forms of lengths, the moments of a log-normal distribution, published statures."""

import numpy as np
import pytest

from pacmo_core.augmentation.bodies import (
    BodyBones,
    Population,
    profile_scales,
    sample_scales,
    segment_scales,
)
from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import NTU25, SBU15
from tests.data.test_segments import DUO27, PRIOR17


def body(skeleton=NTU25, leg: float = 0.4) -> BodyBones:
    """Give every bone 0.2 m, thighs and shins ``leg``."""
    named = segments(skeleton)
    return BodyBones(named, np.array([leg if s.part == "leg" else 0.2 for s in named]))


def by_segment(measured: BodyBones, scales: np.ndarray) -> dict[str, float]:
    return dict(zip([s.name for s in measured.segments], scales.tolist(), strict=True))


def test_a_stature_is_that_of_drillis_and_continis_legs() -> None:
    # Thigh and shin are 0.245 and 0.246 of stature.
    assert body(leg=0.2455 * 1.8).stature == pytest.approx(1.8)


def test_a_child_has_the_stature_and_sitting_height_of_children() -> None:
    measured = body(leg=0.2455 * 1.8)
    scales = by_segment(measured, profile_scales(measured, "child"))
    leg, trunk, arm = scales["left_thigh"], scales["spine_mid"], scales["left_forearm"]
    assert arm == pytest.approx(1.273 / 1.8)
    # Sitting height takes 0.54 of a child's stature, 0.52 of an adult's.
    assert trunk / leg == pytest.approx((0.54 / 0.46) / (0.52 / 0.48))
    assert 0.52 * trunk + 0.48 * leg == pytest.approx(arm)


def test_a_tall_adult_is_two_deviations_above_the_mean_and_in_proportion() -> None:
    measured = body(PRIOR17, leg=0.2455 * 1.7)
    scales = profile_scales(measured, "tall_adult")
    np.testing.assert_allclose(scales, (1.756 + 2 * 0.069) / 1.7)


def test_long_arms_change_arms_only() -> None:
    measured = body(DUO27)
    scales = by_segment(measured, profile_scales(measured, "long_arms"))
    assert scales["left_forearm"] == scales["right_upper_arm"] == pytest.approx(1.1)
    assert scales["left_thigh"] == scales["left_collar"] == scales["spine"] == 1


def test_segment_scales_multiply_with_the_uniform_scale() -> None:
    scales = by_segment(body(), segment_scales(body(), {"uniform": 0.8, "left_forearm": 1.25}))
    assert scales["left_forearm"] == pytest.approx(1.0)
    assert {value for name, value in scales.items() if name != "left_forearm"} == {0.8}


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="no segment left_tail; there are uniform, .*left_forearm"):
        segment_scales(body(), {"left_tail": 1.2})
    with pytest.raises(ValueError, match="no profile 'giant'; there are child, tall_adult"):
        profile_scales(body(), "giant")
    legless = BodyBones(segments(NTU25)[:4], np.ones(4))
    with pytest.raises(ValueError, match="no thigh to estimate the stature from; segments: head"):
        profile_scales(legless, "child")


POPULATION = Population(stature=0.05, proportion=0.03, random_seed=4)


def test_sampled_bodies_are_symmetric_and_log_normal() -> None:
    measured = body()
    rows = [by_segment(measured, sample_scales(measured, POPULATION, f"n{i}")) for i in range(1500)]
    assert all(row["left_forearm"] == row["right_forearm"] for row in rows)
    logs = np.log([[row["left_forearm"], row["head"]] for row in rows])
    # Two segments share stature, and have proportions of their own.
    covariance = np.cov(logs.T)
    tolerance = 4 * (0.05**2 + 0.03**2) * np.sqrt(2 / len(rows))
    np.testing.assert_allclose(covariance.diagonal(), 0.05**2 + 0.03**2, atol=tolerance)
    np.testing.assert_allclose(covariance[0, 1], 0.05**2, atol=tolerance)
    np.testing.assert_allclose(logs.mean(axis=0), 0, atol=4 * 0.06 / np.sqrt(len(rows)))


def test_a_sampled_body_is_the_same_on_another_skeleton() -> None:
    one, other = (
        by_segment(measured, sample_scales(measured, POPULATION, "r0001"))
        for measured in (body(), body(SBU15))
    )
    shared = one.keys() & other.keys()
    assert shared >= {"left_forearm", "right_shin", "head"}
    assert {name: one[name] for name in shared} == {name: other[name] for name in shared}
    again = Population(stature=0.05, proportion=0.03, random_seed=5)
    assert by_segment(body(), sample_scales(body(), again, "r0001")) != one
