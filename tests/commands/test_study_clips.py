"""Truth: motions of the embedded default with the camera's noise, and the same without it."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks._study_clips import bone_variation, classify, third_difference, write_clips
from pacmo_core.commands.study_clips import CUTOFF_HZ, blinded, low_pass, with_noise_of
from pacmo_core.store.motions import stream_motions
from pacmo_core.synthesis.capture import sample_interaction
from pacmo_core.synthesis.script import sample_scripts

N_CLIPS = 60


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_clips(tmp_path_factory.mktemp("study"), N_CLIPS, 7)


def test_a_simple_classifier_of_what_the_browser_gets_stays_at_chance(
    folders: tuple[Path, Path],
) -> None:
    seen = classify(*folders, N_CLIPS, 0)
    low, high = seen.pop("chance_low"), seen.pop("chance_high")
    assert seen.pop("unblinded_third_difference") > 0.9  # the same classifier
    assert {name: value for name, value in seen.items() if not low < value < high} == {}


@pytest.mark.scheduled
@pytest.mark.parametrize("seed", [1, 2])
def test_simple_classifiers_of_many_clips_stay_at_chance(tmp_path: Path, seed: int) -> None:
    seen = classify(*write_clips(tmp_path, 200, seed), 200, seed)
    low, high = seen.pop("chance_low"), seen.pop("chance_high")
    assert seen.pop("unblinded_third_difference") > 0.9
    assert {name: value for name, value in seen.items() if not low < value < high} == {}


def test_a_generated_motion_gets_the_noise_of_its_capture_and_the_partner_none(
    folders: tuple[Path, Path],
) -> None:
    lacking, given = [], []
    for (_, capture), (_, reaction) in zip(
        *(stream_motions(folder / "motions.parquet") for folder in folders), strict=True
    ):
        seen = with_noise_of(capture, reaction, np.random.default_rng(0))
        np.testing.assert_array_equal(seen.person_a, capture.person_a)
        roughness = [third_difference([x.person_b]) for x in (capture, reaction, seen)]
        lacking.append(roughness[1] / roughness[0])
        given.append(roughness[2] / roughness[0])
    assert np.mean(lacking) < 0.5
    assert np.mean(given) == pytest.approx(1, abs=0.1)


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
