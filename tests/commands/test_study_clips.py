"""Truth: motions of the embedded default with the camera's noise, and the same without it."""

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pacmo_core.commands.study_clips import CUTOFF_HZ, blinded, low_pass, sample_items
from pacmo_core.commands.study_store import REAL, Item
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.store.motions import write_motions
from pacmo_core.synthesis.capture import noiseless_motion, sample_interaction, to_camera_frame
from pacmo_core.synthesis.script import ACTIONS, sample_scripts

N_CLIPS = 60
NO_FILTER = 15.0


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Write captures, and as their reactions person b without the camera's noise."""
    root = tmp_path_factory.mktemp("study")
    clips, reactions = root / "clips", root / "reactions"
    scripts = sample_scripts(7, population=7, pairs=6, actions=tuple(ACTIONS), replications=1)
    with (
        write_motions(clips / "motions.parquet", NTU25) as captured,
        write_motions(reactions / "motions.parquet", NTU25) as generated,
    ):
        for number, (script, random) in enumerate(scripts):
            capture = sample_interaction(script, random)
            smooth = to_camera_frame(
                noiseless_motion(script, np.random.default_rng(number), "b"), script.view
            )
            reaction = Interaction(
                NTU25, capture.times, capture.person_a, smooth.astype(np.float32)
            )
            captured.add(f"c{number:03d}", capture)
            generated.add(f"c{number:03d}#b#0", reaction)
    return clips, reactions


def unpack(item: Item) -> list[NDArray[np.float64]]:
    """Decode both people from what the browser gets."""
    (scene,) = json.loads(item.scene)
    people = (np.frombuffer(base64.b64decode(text), "<i2") for text in scene["motions"])
    shape = (-1, len(scene["joints"]), 3)
    return [motion.reshape(shape) * scene["step"] + scene["origin"] for motion in people]


def third_difference(people: list[NDArray[np.float64]]) -> float:
    return float(np.mean([np.linalg.norm(np.diff(m, 3, axis=0), axis=-1).mean() for m in people]))


def bone_variation(people: list[NDArray[np.float64]]) -> float:
    parent, child = NTU25.bones.T
    lengths = [np.linalg.norm(m[:, child] - m[:, parent], axis=-1) for m in people]
    return float(np.mean([bones.std(axis=0).mean() for bones in lengths]))


def accuracy(values: NDArray[np.float64], labels: NDArray[np.bool_]) -> float:
    """Fit the best threshold to one half of the clips; return its accuracy in the other."""
    train, test = np.arange(len(values)) % 4 < 2, np.arange(len(values)) % 4 >= 2
    hits = [
        ((sign * values > sign * limit) == labels, (sign, limit))
        for limit in values[train]
        for sign in (1, -1)
    ]
    best, _ = max(hits, key=lambda hit: hit[0][train].mean())
    return float(best[test].mean())


@pytest.mark.parametrize("feature", [third_difference, bone_variation])
def test_a_simple_classifier_of_what_the_browser_gets_stays_at_chance(
    folders: tuple[Path, Path], feature: Callable[[Any], float]
) -> None:
    items = list(sample_items(*folders, N_CLIPS, np.random.default_rng(0), CUTOFF_HZ))
    labels = np.array([item.kind == REAL for item in items])
    seen = accuracy(np.array([feature(unpack(item)) for item in items]), labels)
    # Three standard deviations of 60 guesses.
    assert abs(seen - 0.5) < 3 * 0.5 / np.sqrt(N_CLIPS)


def test_without_the_filter_the_same_classifier_tells_every_clip(
    folders: tuple[Path, Path],
) -> None:
    items = list(sample_items(*folders, N_CLIPS, np.random.default_rng(0), NO_FILTER))
    labels = np.array([item.kind == REAL for item in items])
    values = np.array([third_difference(unpack(item)) for item in items])
    assert accuracy(values, labels) > 0.8


def test_a_slow_motion_passes_the_filter_and_a_fast_one_does_not() -> None:
    phase = np.pi * (np.arange(60) + 0.5) / 60
    wave = np.zeros((60, 2, 3), np.float32)
    wave[:, 0, 0], wave[:, 1, 1] = np.cos(4 * phase), np.cos(30 * phase)  # 1 Hz and 7.5 Hz
    filtered = low_pass(wave, 30.0, 2.0)
    np.testing.assert_allclose(filtered[:, 0], wave[:, 0], atol=1e-6)
    np.testing.assert_allclose(filtered[:, 1], 0, atol=1e-6)


def test_bones_of_a_shown_clip_have_one_length() -> None:
    script, random = next(
        iter(sample_scripts(7, population=7, pairs=1, actions=("push",), replications=1))
    )
    shown = blinded(sample_interaction(script, random), CUTOFF_HZ)
    assert bone_variation([shown.person_a, shown.person_b]) < 1e-6
