"""Truth: the people of an interaction, whose roles and world are conventions."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25, SBU15
from pacmo_core.data.transforms import Frame, body_frame
from pacmo_core.reaction.data import (
    MotionPairs,
    RandomAugmentation,
    expand_directions,
    frame_rate_matrix,
    random_transforms,
    replace_reaction,
    sample_motion_pairs,
    to_partner_frame,
    with_random_parts,
)
from pacmo_core.reaction.inputs import Normalisation
from pacmo_core.reaction.settings import AugmentationSettings, PartsSettings
from tests.reaction.problems import NO_AUGMENTATION, clips, delayed_mirror
from tests.strategies import make_interaction


def test_a_partner_starts_at_the_origin_and_frames_on_the_grid_are_kept() -> None:
    clip = delayed_mirror(3, np.linspace(0, 2, 33))
    pairs = sample_motion_pairs([clip], 17)
    local = body_frame(clip.person_a, clip.skeleton).to_local(clip.person_b)[::2].reshape(17, -1)
    np.testing.assert_allclose(pairs.reaction[0].numpy(), local, atol=1e-5)
    np.testing.assert_allclose(pairs.partner[0, 0, 6:9].numpy(), 0, atol=1e-6)
    assert pairs.log_duration.item() == pytest.approx(math.log(2))


def test_functions_do_not_change_when_the_world_turns() -> None:
    clip = delayed_mirror(3, np.linspace(0, 2, 33))
    world = Frame(origin=np.array([3.0, 1.0, -2.0]), yaw=1.2)
    moved = replace(
        clip, person_b=world.to_world(clip.person_b), person_a=world.to_world(clip.person_a)
    )
    here, there = sample_motion_pairs([clip], 17), sample_motion_pairs([moved], 17)
    torch.testing.assert_close(there.reaction, here.reaction, atol=1e-5, rtol=0)
    torch.testing.assert_close(there.partner, here.partner, atol=1e-5, rtol=0)


def test_both_directions_are_listed_for_each_interaction() -> None:
    some = clips(3)
    sides = expand_directions(some, both=True)
    assert len(sides) == 6
    assert np.array_equal(sides[4].person_b, some[1].person_a)
    assert expand_directions(some, both=False) == some


def test_random_parts_are_of_their_clips_and_as_long_as_is_wanted() -> None:
    some = [delayed_mirror(seed, np.linspace(0, 2, 61)) for seed in range(40)]
    settings = PartsSettings(n=2, min_share=0.4, max_share=0.9, random_seed=3)
    shown = with_random_parts(some, settings)
    assert shown[:40] == some
    parts = shown[40:]
    assert len(parts) == 80
    firsts = []
    for part, clip in zip(parts, some * 2, strict=True):
        n = len(part.times)
        assert round(0.4 * 61) <= n <= round(0.9 * 61)
        starts = [k for k in range(62 - n) if np.array_equal(clip.person_a[k], part.person_a[0])]
        (first,) = starts
        np.testing.assert_array_equal(part.person_a, clip.person_a[first : first + n])
        np.testing.assert_array_equal(part.person_b, clip.person_b[first : first + n])
        np.testing.assert_allclose(part.times, np.arange(n) / 30, atol=1e-9)
        firsts.append(first)
    assert len(set(firsts)) > 10
    again = with_random_parts(some, settings)
    assert [len(part.times) for part in again] == [len(part.times) for part in shown]
    assert with_random_parts(some, replace(settings, n=0)) == some


@pytest.mark.parametrize(
    ("least", "most", "n"), [(0.5, 0.4, 1), (0, 0.5, 1), (0.5, 1.1, 1), (1, 1, -1)]
)
def test_parts_that_are_none_are_refused(least: float, most: float, n: int) -> None:
    with pytest.raises(ValueError, match="min_share"):
        PartsSettings(n=n, min_share=least, max_share=most, random_seed=0)


def test_bodies_of_different_joints_are_refused() -> None:
    first, second = clips(2)
    with pytest.raises(ValueError, match="one skeleton"):
        sample_motion_pairs([first, second.without(["head"])], 17)
    with pytest.raises(ValueError, match="no interaction"):
        sample_motion_pairs([], 17)


def test_normalised_training_data_are_centred_and_of_unit_scale_and_come_back() -> None:
    pairs = sample_motion_pairs(clips(20), 17)
    norm = Normalisation(channels=45)
    norm.fit(pairs)
    both = torch.cat(
        [norm.normalise_partner(pairs.partner), norm.normalise_reaction(pairs.reaction)]
    )
    assert both.mean().abs() < 1e-5
    assert both.square().mean().item() == pytest.approx(1, rel=1e-5)
    again = norm.denormalise_reaction(norm.normalise_reaction(pairs.reaction))
    torch.testing.assert_close(again, pairs.reaction, atol=1e-6, rtol=1e-5)


def random_clip(seed: int, n_frames: int = 30, fps: float = 30) -> Interaction:
    return make_interaction(np.random.default_rng(seed), n_frames, NTU25, fps)


def test_the_partner_starts_at_the_origin():
    seen = to_partner_frame(random_clip(1))
    np.testing.assert_allclose(seen.person_a[0, NTU25.root], 0, atol=1e-6)


def test_distances_between_the_two_are_kept():
    before, after = random_clip(2), to_partner_frame(random_clip(2))
    np.testing.assert_allclose(
        np.linalg.norm(after.person_a - after.person_b, axis=-1),
        np.linalg.norm(before.person_a - before.person_b, axis=-1),
        atol=1e-5,
    )


def test_where_the_world_stands_does_not_matter():
    turn, shift = Rotation.from_euler("y", 1.1).as_matrix(), np.array([3.0, -1.0, 2.0])
    here = random_clip(3)
    there = replace(
        here,
        person_a=(here.person_a @ turn.T + shift).astype(np.float32),
        person_b=(here.person_b @ turn.T + shift).astype(np.float32),
    )
    np.testing.assert_allclose(
        to_partner_frame(there).person_b, to_partner_frame(here).person_b, atol=1e-5
    )


def test_pairing_a_reaction_with_its_own_partner_changes_nothing():
    own = random_clip(4)
    np.testing.assert_allclose(replace_reaction(own, own).person_b, own.person_b, atol=1e-5)


def test_a_permuted_reaction_is_resampled_to_the_other_partners_duration():
    partner, other = random_clip(5, n_frames=40, fps=15), random_clip(6, n_frames=20)
    replaced = replace_reaction(partner, other)
    assert replaced.person_a is partner.person_a
    np.testing.assert_allclose(replaced.person_b[0], other.person_b[0], atol=1e-6)
    np.testing.assert_allclose(replaced.person_b[-1], other.person_b[-1], atol=1e-6)


PAIRS = sample_motion_pairs(clips(6), 17)
PLAIN = NO_AUGMENTATION


def augmented(
    settings: AugmentationSettings, pairs: MotionPairs = PAIRS, seed: int = 0
) -> MotionPairs:
    return RandomAugmentation(settings, SBU15, 17)(pairs, torch.Generator().manual_seed(seed))


def as_joints(motion: torch.Tensor) -> torch.Tensor:
    return motion.unflatten(-1, (-1, 3))


def between(pairs: MotionPairs) -> torch.Tensor:
    return torch.cdist(as_joints(pairs.partner), as_joints(pairs.reaction))


def test_all_zero_changes_nothing() -> None:
    found = augmented(PLAIN)
    torch.testing.assert_close(found.partner, PAIRS.partner)
    torch.testing.assert_close(found.reaction, PAIRS.reaction)


def test_a_mirror_image_has_left_and_right_exchanged_and_mirrored_again_is_the_original() -> None:
    once = augmented(replace(PLAIN, mirror_probability=1.0))
    left, right = SBU15.indices(["left_hand", "right_hand"])
    expected = as_joints(PAIRS.reaction)[:, :, left] * torch.tensor([-1.0, 1.0, 1.0])
    torch.testing.assert_close(as_joints(once.reaction)[:, :, right], expected)
    twice = augmented(replace(PLAIN, mirror_probability=1.0), once)
    torch.testing.assert_close(twice.partner, PAIRS.partner)


def test_a_rotation_keeps_heights_and_all_distances_between_the_bodies() -> None:
    found = augmented(replace(PLAIN, rotation_spread=1.0))
    assert (found.partner - PAIRS.partner).abs().max() > 0.1
    torch.testing.assert_close(as_joints(found.partner)[..., 1], as_joints(PAIRS.partner)[..., 1])
    torch.testing.assert_close(between(found), between(PAIRS), atol=1e-4, rtol=1e-4)


def test_a_size_scales_both_people_alike() -> None:
    found = augmented(replace(PLAIN, size_spread=0.2))
    ratio = (between(found) / between(PAIRS)).flatten(1)
    torch.testing.assert_close(ratio, ratio[:, :1].expand_as(ratio), atol=1e-3, rtol=1e-3)
    assert ratio[:, 0].std() > 0.05


def test_transforms_are_proper_rotations() -> None:
    place = random_transforms(
        5, replace(PLAIN, rotation_spread=1.0), torch.Generator().manual_seed(0)
    )
    torch.testing.assert_close(place @ place.mT, torch.eye(3).expand(5, 3, 3))
    torch.testing.assert_close(torch.linalg.det(place), torch.ones(5))


def test_frames_enough_for_a_smooth_function_lose_nothing_and_too_few_do() -> None:
    times = torch.linspace(0, 1, 33)
    smooth, fast = torch.sin(3 * times), torch.sin(60 * times)
    assert (frame_rate_matrix(33, 17) @ smooth - smooth).abs().max() < 1e-4
    assert (frame_rate_matrix(33, 17) @ fast - fast).abs().max() > 0.1


def test_a_lower_frame_rate_is_the_partners_alone() -> None:
    found = [augmented(replace(PLAIN, min_rate=0.3), seed=seed) for seed in range(8)]
    assert all(torch.allclose(pairs.reaction, PAIRS.reaction) for pairs in found)
    changes = [float((pairs.partner - PAIRS.partner).abs().max()) for pairs in found]
    assert max(changes) > 1e-5
    assert len({round(change, 9) for change in changes}) > 3  # a rate a batch
    np.testing.assert_allclose(found[0].partner[:, 0], PAIRS.partner[:, 0], atol=1e-6)


def test_an_offset_lasts_and_moves_all_joints_of_the_partner_but_its_root() -> None:
    found = augmented(replace(PLAIN, joint_offset=0.05))
    torch.testing.assert_close(found.reaction, PAIRS.reaction)
    moved = as_joints(found.partner - PAIRS.partner)
    torch.testing.assert_close(moved, moved[:, :1].expand_as(moved), atol=1e-6, rtol=0)
    torch.testing.assert_close(moved[:, :, SBU15.root], torch.zeros(len(PAIRS), 17, 3))
    others = [joint for joint in range(len(SBU15.joints)) if joint != SBU15.root]
    assert 0.04 < float(moved[:, 0, others].std()) < 0.06


def test_noise_differs_from_one_time_to_the_next_and_in_its_level() -> None:
    many = PAIRS.repeat(20)
    moved = augmented(replace(PLAIN, joint_noise=0.02), many).partner - many.partner
    levels = moved.flatten(1).std(dim=1)  # uniform from 0 to twice the mean
    assert 0.016 < float(levels.mean()) < 0.024 and 0.035 < float(levels.max()) < 0.045
    alike = torch.corrcoef(torch.stack([moved[:, 3].flatten(), moved[:, 4].flatten()]))[0, 1]
    assert abs(float(alike)) < 0.05


def test_a_tempo_changes_the_duration_alone() -> None:
    found = augmented(replace(PLAIN, tempo_spread=0.2), PAIRS.repeat(50))
    torch.testing.assert_close(found.partner, PAIRS.repeat(50).partner)
    torch.testing.assert_close(found.reaction, PAIRS.repeat(50).reaction)
    assert 0.17 < float((found.log_duration - PAIRS.repeat(50).log_duration).std()) < 0.23


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"tempo_spread": -0.1}, "tempo_spread must be at least 0"),
        ({"joint_offset": -0.1}, "joint_offset must be at least 0"),
        ({"joint_noise": -0.1}, "joint_noise must be at least 0"),
        ({"mirror_probability": 1.5}, "mirror_probability must be in"),
        ({"size_spread": -0.1}, "size_spread must be at least 0; got -0.1"),
        ({"rotation_spread": -0.1}, "rotation_spread must be at least 0; got -0.1"),
        ({"min_rate": 0.0}, "min_rate must be in"),
    ],
)
def test_settings_out_of_range_are_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(PLAIN, **wrong)
