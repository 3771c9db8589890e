"""What is trusted: the training without variations, and what an uninterrupted training writes."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pacmo_core.data.skeleton import SBU15
from pacmo_core.reaction import wgan
from pacmo_core.reaction.variations import (
    AugmentedWganTrainer,
    TrainingVariations,
    VariationSampler,
    add_variations,
)
from pacmo_core.store.motions import motion_file, stream_motions, write_motions
from pacmo_core.store.tables import SplitRecord, write_rows
from pacmo_core.store.weights import read_weights
from stages import train
from tests.reaction.problems import PACMO, clips
from tests.stages.training import prepare

CLIPS, SPLITS, MADE = Path("clips"), Path("splits.parquet"), Path("variations/motions")
SETTINGS = replace(PACMO, n_epochs=6)


@pytest.fixture(autouse=True)
def project(tmp_path, monkeypatch):
    """Stand in a folder with clips, variations of them all and parameters."""
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DVC_STUDIO_OFFLINE", "true")
    vary(tmp_path / MADE)
    threads = torch.get_num_threads()
    yield tmp_path
    torch.use_deterministic_algorithms(mode=False)
    torch.set_num_threads(threads)


def vary(path: Path) -> None:
    """Write two variations of each clip, taller by so much."""
    for name, clip in stream_motions(CLIPS / "motions.parquet"):
        with write_motions(motion_file(path, name), SBU15) as writer:
            for scale in (1.1, 1.2):
                taller = replace(clip, person_a=clip.person_a * np.float32(scale))
                writer.add(f"{name}~a-uniform-{scale:.2f}", taller)


def paths(share: float, model: str = "models/m") -> argparse.Namespace:
    return argparse.Namespace(
        clips=CLIPS, splits=SPLITS, variations=MADE, model=Path(model), curve=Path("curves/m.csv"),
        model_name="pacmo_augmented", seed=1, share=share,
    )  # fmt: skip


def tensors(model: str) -> dict[str, torch.Tensor]:
    return read_weights(Path(model) / "weights.safetensors")[1]


def test_without_a_share_it_trains_what_train_pacmo_trains():
    plain_paths = paths(0.0, "models/p")
    plain_paths.curve = Path("curves/p.csv")
    plain_paths.model_name, plain_paths.variations = "pacmo", None
    train.main(plain_paths)
    train.main(paths(0.0))
    plain, augmented = tensors("models/p"), tensors("models/m")
    assert plain.keys() == augmented.keys()
    assert all(torch.equal(plain[name], augmented[name]) for name in plain)
    assert Path("curves/p.csv").read_bytes() == Path("curves/m.csv").read_bytes()


def test_with_a_share_it_takes_as_many_steps_and_learns_something_else():
    train.main(paths(0.0, "models/p"))
    train.main(paths(0.5))
    assert any(
        not torch.equal(a, b)
        for a, b in zip(tensors("models/p").values(), tensors("models/m").values(), strict=True)
    )
    plain, wide = (wgan.build_training(clips(8), SETTINGS).trainer for _ in range(2))
    varied = AugmentedWganTrainer(
        wide, TrainingVariations(interactions=clips(4), sources=[0, 0, 3, 7], share=0.5)
    )
    varied.train_epoch(0)
    assert varied.trainer.steps_per_epoch == plain.steps_per_epoch
    assert len(varied.trainer.pairs) == len(plain.pairs)
    first = varied.trainer.pairs.partner
    varied.train_epoch(1)
    assert not torch.equal(varied.trainer.pairs.partner, first)


def test_only_variations_of_clips_that_are_trained_on_are_seen():
    found = train.read_variations(paths(0.5))
    names = [name for name, _ in stream_motions(CLIPS / "motions.parquet")]
    trained = dict(enumerate(names[2:]))  # two are for validation
    own = dict(stream_motions(CLIPS / "motions.parquet"))
    assert len(found.interactions) == 2 * len(trained)
    for source, varied in zip(found.sources, found.interactions, strict=True):
        np.testing.assert_array_equal(varied.person_b, own[trained[source]].person_b)


def test_variations_of_no_training_clip_are_refused_by_the_name_of_their_file():
    rows = [SplitRecord(name, "test") for name, _ in stream_motions(CLIPS / "motions.parquet")]
    rows[0] = replace(rows[0], split="train")
    write_rows(SPLITS, SplitRecord, rows)
    for file in MADE.iterdir():
        file.unlink()
    with pytest.raises(ValueError, match="variations/motions: wanted"):
        train.read_variations(paths(0.5))


def test_every_variation_of_a_pair_is_sampled_with_its_probability():
    sampler = VariationSampler(4, np.array([2, 0, 2, 2]))
    random = np.random.default_rng(1)
    samples = np.stack([sampler.sample(0.6, random) for _ in range(4000)])
    variations = {0: [5], 1: [], 2: [4, 6, 7], 3: []}
    for pair, of_pair in variations.items():
        shown = samples[:, pair]
        assert set(shown) == {pair, *of_pair}
        for variation in of_pair:
            assert (shown == variation).mean() == pytest.approx(0.6 / len(of_pair), abs=0.03)


def test_a_variation_replaces_its_clip_in_both_directions():
    base, made = clips(3), clips(5)[3:]
    variations = TrainingVariations(interactions=made, sources=[2, 0], share=1.0)
    plain = wgan.build_training(base, replace(SETTINGS, both_directions=True))
    varied = add_variations(plain, variations).trainer
    varied.train_epoch(0)
    shown = varied.trainer.pairs
    alone = wgan.build_training(
        [made[1], base[1], made[0]], replace(SETTINGS, both_directions=True)
    ).trainer.pairs
    torch.testing.assert_close(shown.partner, alone.partner)
    torch.testing.assert_close(shown.reaction, alone.reaction)


def test_a_training_that_goes_on_from_a_snapshot_ends_as_the_whole():
    def begin():
        variations = TrainingVariations(interactions=clips(4), sources=[0, 1, 1, 5], share=0.5)
        return add_variations(wgan.build_training(clips(8), SETTINGS), variations)

    whole = begin()
    whole.finish()
    first, second = begin(), begin()
    for _, _ in zip(range(3), first, strict=False):
        pass
    second.restore(first.snapshot())
    second.finish()
    one, two = whole.model.state_dict(), second.model.state_dict()
    assert all(torch.equal(one[name], two[name]) for name in one)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"share": 1.5}, "share must be in"),
        ({"sources": [0]}, "a source each"),
        ({"interactions": [], "sources": []}, "a source each"),
    ],
)
def test_variations_that_are_none_are_refused(fault, words):
    given = {"interactions": clips(2), "sources": [0, 1], "share": 0.5} | fault
    with pytest.raises(ValueError, match=words):
        TrainingVariations(**given)


def test_a_source_that_is_no_clip_is_refused():
    variations = TrainingVariations(interactions=clips(1), sources=[3], share=0.5)
    with pytest.raises(ValueError, match="indices of 3 clips"):
        add_variations(wgan.build_training(clips(3), SETTINGS), variations)
