"""Truth: the offline reaction to the last window, at its end."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.interaction import bone_lengths
from pacmo_core.operators.spline import Spline
from pacmo_core.reaction import baselines, wgan
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inference import react
from pacmo_core.reaction.stream import ReactionStream
from pacmo_core.reaction.windows import mean_duration
from tests.reaction.problems import GRU, PACMO_LONG, clips, delayed_mirror


@pytest.fixture(scope="module")
def model() -> Generator:
    return wgan.build_training(clips(8), replace(PACMO_LONG, n_epochs=4)).finish()


def streamed(model: Generator, n_frames: int, began: float = 0.0) -> np.ndarray:
    clip = delayed_mirror(5, np.arange(n_frames) / 30)
    live = ReactionStream(model, n_samples=2, random=torch.Generator().manual_seed(1))
    pairs = zip(clip.person_a, clip.times, strict=True)
    return np.stack([live.react(pose, began + float(time)) for pose, time in pairs], axis=1)


def test_a_streamed_reaction_is_that_of_the_last_window(
    model: Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pacmo_core.reaction.stream.FRAME_SMOOTHING", 0.0)
    # Noise that stays: the stream moves on in it, and the single window does not.
    fixed = model.sample_noise(2, torch.Generator().manual_seed(1))
    monkeypatch.setattr(
        "pacmo_core.reaction.windows.ContinuousNoise.coefficients", lambda self, start: fixed
    )
    duration = mean_duration(model.normalisation)
    clip = delayed_mirror(5, np.arange(round(90 * duration)) / 30)
    window = np.linspace(clip.times[-1] - duration, clip.times[-1], 301)
    motion = Spline(clip.times, clip.person_a)(window).astype(np.float32)
    random = torch.Generator().manual_seed(1)
    at_end = react(model, motion, window, out_times=window[-1:], n_samples=2, random=random)
    last = streamed(model, len(clip.times))[:, -1]
    np.testing.assert_allclose(last, at_end[:, 0], atol=1e-3)


def test_reactions_do_not_jump_and_go_on_after_the_window_is_full(model: Generator) -> None:
    reactions = streamed(model, 150)
    assert reactions.shape == (2, 150, 15, 3)
    steps = np.linalg.norm(np.diff(reactions, axis=1), axis=-1).max(axis=-1)[:, 1:]
    assert steps.max() < 8 * np.median(steps)


def test_reactions_do_not_depend_on_when_the_clock_began(model: Generator) -> None:
    np.testing.assert_allclose(streamed(model, 70, began=1e6), streamed(model, 70), atol=1e-3)


def test_noise_goes_on_before_a_partner_who_stands_still(model: Generator) -> None:
    pose = delayed_mirror(5, np.arange(5) / 30).person_a[0]
    live = ReactionStream(model, n_samples=1, random=torch.Generator().manual_seed(1))
    first, *_, last = (live.react(pose, time) for time in np.linspace(0, 1, 31).tolist())
    assert np.abs(last - first).max() > 1e-4


def test_the_baseline_streams_too() -> None:
    model = baselines.build_gru_training(clips(8), replace(GRU, n_epochs=1)).finish()
    live = ReactionStream(model, n_samples=1, random=torch.Generator())
    assert live.react(delayed_mirror(0, np.arange(5) / 15).person_a[0], 0.0).shape == (1, 15, 3)
    with pytest.raises(ValueError, match="deterministic"):
        ReactionStream(model, n_samples=2, random=torch.Generator())


def test_poses_of_another_shape_and_times_that_stand_still_are_refused(model: Generator) -> None:
    pose = delayed_mirror(0, np.arange(5) / 15).person_a[0]
    live = ReactionStream(model, n_samples=1, random=torch.Generator())
    with pytest.raises(ValueError, match=r"\(15, 3\)"):
        live.react(pose[:4], 0.0)
    with pytest.raises(ValueError, match="finite"):
        live.react(pose, float("nan"))
    broken = pose.copy()
    broken[live._model.skeleton.joints.index("head")] = np.nan
    with pytest.raises(ValueError, match="finite numbers; that of head is not"):
        live.react(broken, 0.0)
    live.react(pose, 1.0)
    with pytest.raises(ValueError, match="later than 1 s"):
        live.react(pose, 1.0)


def test_after_a_long_pause_and_a_clock_that_is_set_back_a_stream_begins_anew(
    model: Generator,
) -> None:
    clip = delayed_mirror(5, np.arange(150) / 30)
    live = ReactionStream(model, n_samples=1, random=torch.Generator().manual_seed(1))
    for start in (0.0, 200.0, 0.0):
        for pose, time in zip(clip.person_a, clip.times.tolist(), strict=True):
            reaction = live.react(pose, start + time)
    fresh = ReactionStream(model, n_samples=1, random=torch.Generator().manual_seed(1))
    fresh._new_noise()  # of the second beginning: the third is of the seeds after it
    fresh._noise = fresh._new_noise()
    for pose, time in zip(clip.person_a, clip.times.tolist(), strict=True):
        expected = fresh.react(pose, time)
    np.testing.assert_allclose(reaction, expected, atol=1e-6)


def test_noise_in_the_partners_heading_hardly_changes_the_reactions(model: Generator) -> None:
    clip = delayed_mirror(5, np.arange(150) / 30)
    random = np.random.default_rng(0)
    # Shoulders and hips that tremble to and fro: no joint moves far, the heading of a pose does.
    noisy = clip.person_a + random.normal(scale=0.01, size=clip.person_a.shape)
    steps = []
    for motion in (clip.person_a, noisy.astype(np.float32)):
        live = ReactionStream(model, n_samples=1, random=torch.Generator().manual_seed(1))
        pairs = zip(motion, clip.times.tolist(), strict=True)
        reactions = np.stack([live.react(pose, time)[0] for pose, time in pairs])
        steps.append(np.diff(reactions[75:], 2, axis=0))
    shaken = np.sqrt(np.square(steps[1] - steps[0]).sum(axis=-1).mean())
    assert shaken < 0.03


def test_finished_frames_have_the_bones_of_the_first_and_no_foot_below_the_floor(
    model: Generator,
) -> None:
    clip = delayed_mirror(5, np.arange(40) / 30)
    random = torch.Generator().manual_seed(1)
    live = ReactionStream(model, n_samples=2, random=random, finish=True)
    pairs = zip(clip.person_a, clip.times, strict=True)
    found = np.stack([live.react(pose, float(time)) for pose, time in pairs], axis=1)
    for reaction in found:
        assert np.ptp(bone_lengths(reaction, clip.skeleton), axis=0).max() < 1e-5
    feet = clip.skeleton.indices(["left_foot", "right_foot"])
    assert found[:, :, feet, 1].min() > clip.person_a[0, feet, 1].min() - 1e-3
    steps = np.linalg.norm(np.diff(found, axis=1), axis=-1).max(axis=-1)[:, 1:]
    assert steps.max() < 8 * np.median(steps)


@pytest.mark.parametrize("pause", [0.4, 5.0, 50.0])
def test_after_a_pause_reactions_go_on_as_before(model: Generator, pause: float) -> None:
    """Frames that are missing, of a partner who stands and is measured with noise."""
    pose = delayed_mirror(5, np.arange(5) / 30).person_a[0]
    noise = np.random.default_rng(2).normal(scale=0.003, size=(60, *pose.shape))
    times = np.arange(60) / 30
    times[30:] += pause
    live = ReactionStream(model, n_samples=1, random=torch.Generator().manual_seed(1))
    pairs = zip((pose + noise).astype(np.float32), times.tolist(), strict=True)
    reactions = np.stack([live.react(seen, time)[0] for seen, time in pairs])
    away = np.linalg.norm(reactions - reactions[0], axis=-1).max(axis=-1)
    assert away[30:].max() < away[:30].max() + 0.3


def test_a_joint_that_is_lost_for_some_frames_stays_beside_the_root(model: Generator) -> None:
    clip = delayed_mirror(5, np.arange(60) / 30)
    hand = clip.skeleton.joints.index("left_hand")
    found = []
    for height in (0.0, 2.0):
        motion = clip.person_a.copy()
        motion[30:33, hand, 1] += np.float32(height)
        live = ReactionStream(model, n_samples=1, random=torch.Generator().manual_seed(1))
        pairs = zip(motion, clip.times.tolist(), strict=True)
        found.append(np.stack([live.react(pose, time)[0] for pose, time in pairs]))
    assert np.abs(found[1] - found[0]).max() < 0.1
