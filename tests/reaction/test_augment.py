"""Truth: reflections, turns and sizes are linear maps of space; a spline keeps what is smooth."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.skeleton import SBU15
from pacmo_core.reaction.augment import Augment, place_of, resampled
from pacmo_core.reaction.functions import MotionPairs, encode
from pacmo_core.reaction.settings import AugmentSettings
from tests.reaction.problems import clips

PAIRS = encode(clips(6), 17)
PLAIN = AugmentSettings(mirror=0.0, size=0.0, turn=0.0, least_rate=1.0)


def augmented(settings: AugmentSettings, pairs: MotionPairs = PAIRS, seed: int = 0) -> MotionPairs:
    return Augment(settings, SBU15, 17)(pairs, torch.Generator().manual_seed(seed))


def joints(motion: torch.Tensor) -> torch.Tensor:
    return motion.unflatten(-1, (-1, 3))


def between(pairs: MotionPairs) -> torch.Tensor:
    return torch.cdist(joints(pairs.partner), joints(pairs.reaction))


def test_all_zero_changes_nothing() -> None:
    found = augmented(PLAIN)
    torch.testing.assert_close(found.partner, PAIRS.partner)
    torch.testing.assert_close(found.reaction, PAIRS.reaction)


def test_a_mirror_image_has_left_and_right_exchanged_and_mirrored_again_is_the_original() -> None:
    once = augmented(replace(PLAIN, mirror=1.0))
    left, right = SBU15.indices(["left_hand", "right_hand"])
    expected = joints(PAIRS.reaction)[:, :, left] * torch.tensor([-1.0, 1.0, 1.0])
    torch.testing.assert_close(joints(once.reaction)[:, :, right], expected)
    twice = augmented(replace(PLAIN, mirror=1.0), once)
    torch.testing.assert_close(twice.partner, PAIRS.partner)


def test_a_turn_keeps_heights_and_all_distances_between_the_bodies() -> None:
    found = augmented(replace(PLAIN, turn=1.0))
    assert (found.partner - PAIRS.partner).abs().max() > 0.1
    torch.testing.assert_close(joints(found.partner)[..., 1], joints(PAIRS.partner)[..., 1])
    torch.testing.assert_close(between(found), between(PAIRS), atol=1e-4, rtol=1e-4)


def test_a_size_scales_both_people_alike() -> None:
    found = augmented(replace(PLAIN, size=0.2))
    ratio = (between(found) / between(PAIRS)).flatten(1)
    torch.testing.assert_close(ratio, ratio[:, :1].expand_as(ratio), atol=1e-3, rtol=1e-3)
    assert ratio[:, 0].std() > 0.05


def test_turns_turn_and_do_not_mirror() -> None:
    place = place_of(5, replace(PLAIN, turn=1.0), torch.Generator().manual_seed(0))
    torch.testing.assert_close(place @ place.mT, torch.eye(3).expand(5, 3, 3))
    torch.testing.assert_close(torch.linalg.det(place), torch.ones(5))


def test_frames_enough_for_a_smooth_function_lose_nothing_and_too_few_do() -> None:
    times = torch.linspace(0, 1, 33)
    smooth, fast = torch.sin(3 * times), torch.sin(60 * times)
    assert (resampled(33, 17) @ smooth - smooth).abs().max() < 1e-4
    assert (resampled(33, 17) @ fast - fast).abs().max() > 0.1


def test_a_lower_frame_rate_is_the_partners_alone() -> None:
    found = [augmented(replace(PLAIN, least_rate=0.3), seed=seed) for seed in range(8)]
    assert all(torch.allclose(pairs.reaction, PAIRS.reaction) for pairs in found)
    changes = [float((pairs.partner - PAIRS.partner).abs().max()) for pairs in found]
    assert max(changes) > 1e-5
    assert len({round(change, 9) for change in changes}) > 3  # a rate a batch
    np.testing.assert_allclose(found[0].partner[:, 0], PAIRS.partner[:, 0], atol=1e-6)


@pytest.mark.parametrize(
    "wrong", [{"mirror": 1.5}, {"size": -0.1}, {"turn": -1.0}, {"least_rate": 0.0}]
)
def test_settings_that_mean_nothing_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must lie in"):
        replace(PLAIN, **wrong)
