"""Truth: the model that the training starts from."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from pacmo_core.models import get_model
from pacmo_core.reaction import wgan
from pacmo_core.reaction.data import Condition
from pacmo_core.reaction.settings import FineTuningSettings
from pacmo_core.store.files import file_hash
from pacmo_core.store.weights import write_weights
from pacmo_core.training.loop import TrainingData
from pacmo_core.training.state import model_config, model_state
from tests.reaction.problems import PACMO, clips

SHORT = replace(PACMO, n_epochs=2)
LABELLED = replace(SHORT, action_channels=2, action_dropout=0.5)
LABELS = ["wave", "hug"] * 2


def start(file: Path) -> FineTuningSettings:
    return FineTuningSettings(str(file), file_hash(file), 0.25)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[wgan.Generator, Path]:
    model = wgan.build_training(clips(4), SHORT).finish()
    file = tmp_path_factory.mktemp("weights") / "weights.safetensors"
    write_weights(file, {"model": "pacmo", "config": model_config(model)}, model_state(model))
    return model, file


def reactions(model: wgan.Generator, action: int = 0) -> torch.Tensor:
    random = torch.Generator().manual_seed(3)
    partner = torch.randn(1, len(model.points), 3 * len(model.skeleton.joints), generator=random)
    noise = model.sample_noise(1, random)
    with torch.no_grad():
        found: torch.Tensor = model(
            noise, Condition(partner, torch.ones(1), torch.tensor([action]))
        )
    return found


def test_a_training_begins_with_the_reactions_of_the_file(
    trained: tuple[wgan.Generator, Path],
) -> None:
    model, file = trained
    begun = wgan.build_training(clips(4), replace(SHORT, random_seed=9, start=start(file))).model
    torch.testing.assert_close(reactions(begun), reactions(model), rtol=0, atol=0)
    other = wgan.build_training(clips(4), replace(SHORT, random_seed=9)).model
    assert not torch.allclose(reactions(other), reactions(model))


@pytest.mark.parametrize("share", [0.0, 0.25, 0.9])
def test_the_model_keeps_a_share_of_the_weights_of_the_file(
    trained: tuple[wgan.Generator, Path], share: float
) -> None:
    model, file = trained
    settings = replace(SHORT, start=replace(start(file), share=share), ema_decay=0.0)
    trainer = wgan.build_training(clips(4), settings).trainer
    trainer.train_epoch(0)
    before, after, kept = (
        one.head[0].weight for one in (model.uno, trainer.generator.uno, trainer.model.uno)
    )
    assert not torch.allclose(before, after)
    torch.testing.assert_close(kept, share * before + (1 - share) * after)


def test_new_labels_change_nothing_until_they_are_learnt(
    trained: tuple[wgan.Generator, Path],
) -> None:
    model, file = trained
    loop = wgan.build_training(clips(4), replace(LABELLED, start=start(file)), actions=LABELS)
    for action in range(3):
        torch.testing.assert_close(reactions(loop.model, action), reactions(model))
    after = loop.finish()
    assert not torch.allclose(reactions(after, 1), reactions(after, 2))


def test_another_file_than_stated_is_refused(trained: tuple[wgan.Generator, Path]) -> None:
    _, file = trained
    wrong = replace(start(file), sha256="0" * 64)
    with pytest.raises(ValueError, match="weights.safetensors: wanted the SHA-256 000.*; got"):
        wgan.build_training(clips(4), replace(SHORT, start=wrong))
    with pytest.raises(ValueError, match="must both be stated, or none"):
        FineTuningSettings(str(file), "", 0.25)


def test_noise_is_that_of_training_whatever_the_temperature_of_the_file(
    trained: tuple[wgan.Generator, Path], tmp_path: Path
) -> None:
    model, _ = trained
    state = model_state(model) | {"temperature": torch.tensor(1.5)}
    file = tmp_path / "weights.safetensors"
    write_weights(file, {"model": "pacmo", "config": model_config(model)}, state)
    trainer = wgan.build_training(clips(4), replace(SHORT, start=start(file))).trainer
    assert float(trainer.generator.temperature) == float(trainer.ema_generator.temperature) == 1


def test_weights_of_other_joints_noise_or_another_operator_are_refused(
    trained: tuple[wgan.Generator, Path],
) -> None:
    _, file = trained
    fewer = [clip.without(["head"]) for clip in clips(4)]
    with pytest.raises(ValueError, match="wanted the joints .*; got head"):
        wgan.build_training(fewer, replace(SHORT, start=start(file)))
    for change, words in (
        ({"width": 10}, "wanted uno .*channels"),
        ({"noise_alpha": 3.0}, "wanted noise .*alpha=3"),
        ({"noise_channels": 1}, "wanted noise_channels 1; got 2"),
    ):
        with pytest.raises(ValueError, match=words):
            wgan.build_training(clips(4), replace(SHORT, start=start(file), **change))


def test_weights_of_other_labels_are_refused(tmp_path: Path) -> None:
    model = wgan.build_training(clips(4), LABELLED, actions=LABELS).finish()
    file = tmp_path / "weights.safetensors"
    write_weights(file, {"model": "pacmo", "config": model_config(model)}, model_state(model))
    others = replace(LABELLED, start=start(file))
    with pytest.raises(ValueError, match="wanted actions ..., 'kick', 'push'.; got ..., 'hug', 'w"):
        wgan.build_training(clips(4), others, actions=["kick", "push"] * 2)


def test_a_training_that_is_resumed_does_not_begin_again(
    trained: tuple[wgan.Generator, Path],
) -> None:
    _, file = trained
    settings = replace(SHORT, start=start(file))
    first = wgan.build_training(clips(4), settings).trainer
    first.train_epoch(0)
    resumed = wgan.build_training(clips(4), settings).trainer
    resumed.load_state_dict(first.state_dict())
    torch.testing.assert_close(reactions(resumed.generator), reactions(first.generator))
    for trainer in (first, resumed):
        trainer.train_epoch(1)
    torch.testing.assert_close(reactions(resumed.generator), reactions(first.generator))


@pytest.mark.parametrize("has_finish", [True, False])
def test_the_finish_of_the_file_stays_if_it_has_one(
    trained: tuple[wgan.Generator, Path], tmp_path: Path, has_finish: bool
) -> None:
    model, _ = trained
    state = model_state(model)
    known = torch.full_like(model.learnt.contacts, 0.25)
    state |= {"learnt.contacts": known} if has_finish else {}
    file = tmp_path / "weights.safetensors"
    write_weights(file, {"model": "pacmo", "config": model_config(model)}, state)
    data = TrainingData(clips(4), clips(2))
    settings = replace(SHORT, start=start(file))
    after = get_model("pacmo", "reaction").build_training(data, settings).finish()
    assert torch.equal(after.learnt.contacts, known) == has_finish
    assert after.learnt.has_learnt
    assert not torch.equal(reactions(after), reactions(model))
