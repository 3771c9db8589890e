"""Truth: standing bodies of known crouch, and heights that are drawn with known errors."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import NTU25
from pacmo_core.finish.bones import median_lengths, set_legs
from pacmo_core.finish.finish import finish
from pacmo_core.finish.heights import learn_heights, no_change, pelvis_heights, straighten
from pacmo_core.finish.learnt import nothing_learnt
from tests.finish.test_floor import LEG, standing

FPS = 30.0
ANKLES = NTU25.indices(["left_ankle", "right_ankle"])
UPPER = NTU25.indices(["head", "spine_shoulder", "left_hand", "left_hip"])


def crouch(depth: np.ndarray) -> np.ndarray:
    """Lower a body by ``(T,)`` metres over feet that stand, as if legs shrank."""
    motion = np.repeat(standing(LEG)[:1].astype(np.float64), len(depth), axis=0)
    legs = NTU25.indices([f"{side}_{name}" for side in ("left", "right") for name in ("knee",)])
    feet = NTU25.indices([f"{s}_{n}" for s in ("left", "right") for n in ("ankle", "foot")])
    above = [j for j in range(25) if j not in (*legs, *feet)]
    motion[:, above, 1] -= depth[:, None]
    motion[:, legs, 1] -= depth[:, None] / 2
    return motion


def lengths() -> np.ndarray:
    return median_lengths(standing(LEG), NTU25)


def test_heights_are_relative_to_the_legs() -> None:
    for leg in (0.5, 0.8):
        body = standing(leg)
        found = pelvis_heights(body.astype(np.float64), median_lengths(body, NTU25), NTU25)
        np.testing.assert_allclose(
            found, (body[0, NTU25.root, 1] - body[0, ANKLES[0], 1]) / leg, rtol=1e-5
        )
    dips = pelvis_heights(crouch(np.array([0.0, 0.2])), lengths(), NTU25)
    assert dips[0] - dips[1] == pytest.approx(0.2 / LEG)


def test_heights_that_say_nothing_become_the_median_and_others_stay_low() -> None:
    random = np.random.default_rng(3)
    captured = 0.95 + 0.05 * random.random(4000) - 0.2 * (random.random(4000) < 0.2)
    blind = learn_heights([(0.9 + 0.2 * random.random(4000), captured)])
    np.testing.assert_allclose(blind[1, 2:-2], np.median(captured), atol=5e-3)
    # Somebody who sits in both motions, seen with errors, still sits.
    sits = np.where(np.arange(4000) < 1000, 0.5, 1.0)
    generated = sits + 0.05 * random.normal(size=4000)
    model = learn_heights([(generated[::2], sits[::2]), (generated[1::2], sits[1::2])])
    mapped = np.interp(generated, *model)
    assert np.abs(mapped - sits).mean() < 0.005 < np.abs(generated - sits).mean() / 5
    assert (np.diff(mapped[np.argsort(generated)]) >= 0).all()


def test_captured_heights_stay_and_few_frames_teach_nothing() -> None:
    captured = 0.9 + 0.1 * np.random.default_rng(3).random(4000)
    same = learn_heights([(captured, captured)])
    np.testing.assert_allclose(same[0], same[1], atol=1e-4)
    np.testing.assert_array_equal(learn_heights([(np.ones(9), np.ones(9))]), no_change())
    np.testing.assert_array_equal(learn_heights([]), no_change())


def test_a_body_that_squats_is_straightened_over_feet_that_stay() -> None:
    depth = 0.2 * np.sin(np.pi * np.arange(90) / 89) ** 2
    given = crouch(depth)
    before = pelvis_heights(given, lengths(), NTU25)
    upright = before.max()
    model = np.stack([np.linspace(before.min(), upright, 25), np.full(25, upright)])
    found = straighten(given, lengths(), FPS, NTU25, model)
    rise = found[:, UPPER, 1] - given[:, UPPER, 1]
    np.testing.assert_allclose(rise, np.repeat(depth[:, None], len(UPPER), axis=1), atol=0.01)
    # Legs that are nearly straight approach their length gradually: by 1 % at most.
    np.testing.assert_allclose(found[:, ANKLES], given[:, ANKLES], atol=0.01 * LEG)
    np.testing.assert_array_equal(straighten(given, lengths(), FPS, NTU25, no_change()), given)


def test_the_finish_straightens_a_body_of_whole_bones() -> None:
    given = crouch(np.full(60, 0.15))
    feet = given.copy()
    set_legs(given, feet, np.full(given.shape[:2], -np.inf), lengths(), NTU25)
    partner = np.tile(standing(LEG, (0.0, 2.0))[:1], (60, 1, 1))
    upright = float(pelvis_heights(partner.astype(np.float64), lengths(), NTU25)[0])
    model = np.stack([np.linspace(upright - 0.3, upright, 25), np.full(25, upright - 0.02)])
    crouched, straight = (
        pelvis_heights(
            finish(given.astype(np.float32), partner, np.arange(60) / FPS, NTU25, learnt),
            lengths(),
            NTU25,
        )
        for learnt in (nothing_learnt(NTU25), replace(nothing_learnt(NTU25), heights=model))
    )
    np.testing.assert_allclose(crouched, upright - 0.15 / LEG, atol=0.01)
    np.testing.assert_allclose(straight, upright - 0.02, atol=0.02)
