"""Truth: the published size, and partners whose reactions a deterministic model can learn."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pacmo_core.data.skeleton import NTU25
from pacmo_core.reaction import baselines
from pacmo_core.reaction.data import RandomAugmentation, mirror_interaction
from tests.reaction.problems import GRU, REGRESSION, clips


def test_the_papers_baseline_has_its_published_size() -> None:
    skeleton = NTU25.without(["left_hand_tip", "left_thumb", "right_hand_tip", "right_thumb"])
    model = baselines.Gru(baselines.GruConfig(skeleton, fps=30.0, hidden=200, n_layers=5))
    assert sum(p.numel() for p in model.parameters()) == 1_216_863


def test_clips_of_different_lengths_do_not_change_each_other_in_the_baseline() -> None:
    model = baselines.build_gru_training(clips(8), replace(GRU, n_epochs=2)).finish()
    frames = baselines.sample_frames(clips(4), 15.0, "cpu")
    together = model.loss(frames, range(4)).item()
    lengths = np.array([len(motion) for motion in frames.partner])
    alone = np.array([model.loss(frames, [i]).item() for i in range(4)])
    assert together == pytest.approx((alone * lengths).sum() / lengths.sum(), rel=1e-5)


def test_the_baseline_is_trained_on_mirror_images_too() -> None:
    model = baselines.build_gru_training(clips(4), replace(GRU, n_epochs=1)).finish()
    both = RandomAugmentation(replace(GRU.augmentation, mirror_probability=1.0), model.skeleton, 0)
    frames = baselines.sample_frames(clips(4), GRU.fps, "cpu")
    images = baselines.sample_frames([mirror_interaction(clip) for clip in clips(4)], 15.0, "cpu")
    shown = model.training_loss(frames, range(4), both, torch.Generator())
    torch.testing.assert_close(shown, model.loss(images, range(4)))
    assert abs((shown - model.loss(frames, range(4))).item()) > 1e-3
    none = RandomAugmentation(GRU.augmentation, model.skeleton, 0)
    torch.testing.assert_close(
        model.training_loss(frames, range(4), none, torch.Generator()),
        model.loss(frames, range(4)),
    )


@pytest.mark.parametrize("change", [{"min_rate": 0.5}, {"tempo_spread": 0.1}])
def test_a_recurrence_has_one_frame_rate(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="a recurrence has one frame rate"):
        replace(GRU, augmentation=replace(GRU.augmentation, **change))


@pytest.mark.slow
def test_the_baseline_learns() -> None:
    held_out = baselines.sample_frames(clips(8, first_seed=50), GRU.fps, "cpu")
    # From the leading side: the frames seen so far don't tell what the leader will do.
    fitted = baselines.build_gru_training(clips(32), replace(GRU, both_directions=False))
    errors = [fitted.model.loss(held_out, range(8)).item() for _ in fitted]
    assert errors[-1] < 0.4 * errors[0]


@pytest.mark.slow
def test_the_regression_learns_to_follow_its_partner() -> None:
    fitted = baselines.build_regression_training(
        clips(32), REGRESSION, validation=clips(8, first_seed=50)
    )
    curve = list(fitted)
    assert curve[-1]["validation"] < 0.4 * curve[0]["loss"]
