"""Truth: the reactions as the model generates them, and the library's finish of these."""

import argparse
from pathlib import Path

import numpy as np
import pytest
import torch
from ruamel.yaml import YAML

from pacmo_core.data.interaction import bone_lengths
from pacmo_core.data.skeleton import SBU15
from pacmo_core.reaction import wgan
from pacmo_core.reaction.inference import finish_reactions
from pacmo_core.reaction.windows import PartnerMotion
from pacmo_core.store.motions import stream_motions
from pacmo_core.store.tables import SplitRecord, read_rows, write_rows
from pacmo_core.store.weights import write_weights
from pacmo_core.training.state import model_config, model_state
from stages import react
from tests.reaction.problems import PACMO, clips
from tests.stages.training import prepare

CLIPS, SPLITS, MODEL = Path("clips"), Path("splits.parquet"), Path("models/1/pacmo/1")


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Stand in a folder with weights, two test clips and parameters."""
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)
    splits = [row.clip for row in read_rows(SPLITS, SplitRecord)]
    tested = [SplitRecord(clip, "test" if i < 2 else "train") for i, clip in enumerate(splits)]
    write_rows(SPLITS, SplitRecord, tested)
    trained = wgan.build_training(clips(4), PACMO).finish()
    facts = {"model": "pacmo", "config": model_config(trained)}
    write_weights(MODEL / "weights.safetensors", facts, model_state(trained))
    threads = torch.get_num_threads()
    yield trained
    torch.set_num_threads(threads)


def reactions(finished: list[str], *, without_finish: bool = False):
    params = {"react": {"random_seed": 1, "n_samples": 2, "finish": finished}}
    YAML(typ="safe").dump(params, Path("params.yaml"))
    paths = argparse.Namespace(
        model=MODEL, clips=CLIPS, splits=SPLITS, reactions=Path("out"), seed=1,
        without_finish=without_finish,
    )  # fmt: skip
    react.main(paths)
    return dict(stream_motions(Path("out/motions.parquet")))


def test_the_models_that_are_listed_are_finished(model):
    plain, finished = reactions([]), reactions(["gru", "pacmo"])
    assert plain.keys() == finished.keys() and len(plain) == 8
    for name, pair in plain.items():
        partner = PartnerMotion(pair.person_a, pair.times, pair.times)
        (expected,) = finish_reactions(model, partner, pair.person_b[None])
        np.testing.assert_allclose(finished[name].person_b, expected, atol=1e-5)
        np.testing.assert_array_equal(finished[name].person_a, pair.person_a)
        lengths = bone_lengths(finished[name].person_b, SBU15)
        assert np.ptp(lengths, axis=0).max() < 1e-5


def test_none_is_finished_where_the_command_line_says_so(model):
    plain, raw = reactions([]), reactions(["pacmo"], without_finish=True)
    for name, pair in plain.items():
        np.testing.assert_array_equal(raw[name].person_b, pair.person_b)
