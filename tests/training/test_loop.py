"""What is trusted: an uninterrupted training, bit for bit."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice

import pytest
import torch
from torch import Tensor, nn

from pacmo_core.reaction import autoencoder, baselines, flow_matching, wgan
from pacmo_core.store.weights import read_weights, write_weights
from pacmo_core.training.loop import Snapshot, TrainingLoop
from pacmo_core.training.state import model_state
from tests.reaction.problems import AUTOENCODER, FLOW_MATCHING, GRU, PACMO, clips

HELD_OUT = clips(3, first_seed=90)
FITS: dict[str, Callable[[], TrainingLoop[nn.Module]]] = {
    "autoencoder": lambda: autoencoder.build_training(clips(8), AUTOENCODER, validation=HELD_OUT),
    "gru": lambda: baselines.build_gru_training(clips(8), GRU, validation=HELD_OUT),
    "flow_matching": lambda: flow_matching.build_training(
        clips(8), FLOW_MATCHING, validation=HELD_OUT
    ),
    "pacmo": lambda: wgan.build_training(clips(8), PACMO, validation=HELD_OUT),
}


class ScriptedTrainer(nn.Module):
    """A trainer whose validation scores are listed: its one weight is the number of the epoch."""

    def __init__(self, scores: list[float]) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(()))
        self.scores = scores

    @property
    def model(self) -> "ScriptedTrainer":
        """Return itself."""
        return self

    def train_epoch(self, number: int) -> dict[str, float]:
        """Set the weight to the number."""
        self.weight.data.fill_(number + 1)
        return {"loss": float(number)}

    def validate(self) -> dict[str, Tensor]:
        """Return the score listed for the weight."""
        if not self.scores:
            return {}
        return {"validation": torch.tensor(self.scores[int(self.weight.item()) - 1])}


def loop_of(
    scores: list[float], n_epochs: int, validate_every: int = 1
) -> TrainingLoop[ScriptedTrainer]:
    return TrainingLoop(ScriptedTrainer(scores), n_epochs=n_epochs, validate_every=validate_every)


def shortened(fit: TrainingLoop[nn.Module]) -> TrainingLoop[nn.Module]:
    fit.n_epochs = 5
    return fit


@pytest.mark.parametrize("name", FITS)
def test_a_training_that_was_stopped_and_went_on_equals_one_that_was_not(name, tmp_path):
    whole = shortened(FITS[name]())
    whole.finish()
    killed = shortened(FITS[name]())
    with pytest.raises(KeyboardInterrupt):
        for epoch, _ in enumerate(killed, start=1):
            if epoch == 2:
                snapshot = killed.snapshot()
                write_weights(tmp_path / "c", snapshot.facts, snapshot.tensors)
            if epoch == 3:
                raise KeyboardInterrupt
    again = shortened(FITS[name]())
    facts, tensors = read_weights(tmp_path / "c")
    again.restore(Snapshot(tensors, facts))
    assert len(list(again)) == 3
    assert again.curve == whole.curve
    assert again.selection() == whole.selection()
    for part in (TrainingLoop.snapshot, lambda fit: Snapshot(model_state(fit.model), {})):
        ours, theirs = part(again).tensors, part(whole).tensors
        assert ours.keys() == theirs.keys()
        assert all(torch.equal(ours[key], theirs[key]) for key in ours)


def test_a_snapshot_does_not_move_with_the_training_that_goes_on():
    fit = FITS["pacmo"]()
    rounds: Iterator[dict[str, float]] = iter(fit)
    list(islice(rounds, 2))
    snapshot = fit.snapshot()
    before = {name: value.clone() for name, value in snapshot.tensors.items()}
    next(rounds)
    assert all(torch.equal(before[name], value) for name, value in snapshot.tensors.items())
    assert len(snapshot.facts["curve"]) == 2


def test_the_weights_of_the_best_score_are_selected_not_the_last():
    fit = loop_of([3.0, 1.0, 1.0, 2.0], 4)
    terms = list(fit)
    assert fit.model.weight.item() == 2.0
    assert fit.selection() == {"by": "validation", "epoch": 2, "score": 1.0}
    assert [term["validation"] for term in terms] == [3.0, 1.0, 1.0, 2.0]


def test_the_last_epoch_is_validated_at_any_interval():
    fit = loop_of([9.0, 0.0, 9.0, 9.0, 1.0], 5, validate_every=3)
    assert [("validation" in term) for term in fit] == [False, False, True, False, True]
    assert fit.selection()["epoch"] == 5


def test_without_held_out_clips_the_last_weights_are_selected():
    fit = loop_of([], 3)
    assert fit.finish().weight.item() == 3.0
    assert fit.selection() == {"by": "last epoch", "epoch": 3}


def test_a_score_that_is_not_finite_is_refused_by_name():
    with pytest.raises(FloatingPointError, match="epoch 2: validation not finite"):
        loop_of([1.0, float("nan")], 2).finish()


@pytest.mark.parametrize("numbers", [(0, 1), (1, 0)])
def test_no_epochs_are_refused(numbers):
    with pytest.raises(ValueError, match="at least 1; got"):
        loop_of([], *numbers)


def test_the_learning_rate_halves_by_epochs():
    fit = wgan.build_training(clips(8), PACMO)
    training = fit.trainer
    for epoch, rate in ((0, 1), (199, 1), (200, 0.5), (400, 0.25)):
        training.train_epoch(epoch)
        assert training.adam_critic.param_groups[0]["lr"] == rate * PACMO.critic.learning_rate


def test_in_an_epoch_the_critic_sees_each_pair_about_once():
    # 40 directed pairs, 16 a batch, two batches a step.
    fit = wgan.build_training(clips(20), replace(PACMO, warmup_epochs=0))
    drawn, draw = [], fit.trainer._sample_batch
    fit.trainer._sample_batch = lambda **for_critic: drawn.append(for_critic) or draw(**for_critic)
    next(iter(fit))
    assert drawn == [{"for_critic": True}, {"for_critic": True}, {"for_critic": False}] * 2
