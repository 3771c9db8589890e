"""Truth: rigid trunks, shapes that are drawn from known distributions, and a pelvis that swings."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import NTU25, SBU15
from pacmo_core.finish.finish import finish
from pacmo_core.finish.floor import ONE_FLOOR, set_down
from pacmo_core.finish.learnt import nothing_learnt
from pacmo_core.finish.trunk import (
    learn_trunk,
    shape_trunk,
    trunk_joints,
    trunk_size,
    unshaped,
)
from tests.finish.test_floor import LEG, standing
from tests.strategies import make_interaction

JOINTS = list(trunk_joints(NTU25))
LIMBS = [joint for joint in range(len(NTU25.joints)) if joint not in JOINTS]
N_FRAMES = 4000
# Metres: hips, shoulders, spine and head of somebody who stands.
PLACES = {
    "spine_base": (0, 0.9, 0),
    "spine_mid": (0, 1.1, -0.02),
    "spine_shoulder": (0, 1.4, 0),
    "neck": (0, 1.46, 0.01),
    "head": (0, 1.6, 0.05),
    "left_shoulder": (0.18, 1.38, 0),
    "right_shoulder": (-0.18, 1.38, 0),
    "left_hip": (0.09, 0.88, 0),
    "right_hip": (-0.09, 0.88, 0),
}


def body() -> np.ndarray:
    """Return a pose ``(J, 3)`` with arms that hang."""
    pose = standing(LEG)[0].astype(np.float64)
    for name, place in PLACES.items():
        pose[NTU25.joints.index(name)] = place
    for side, x in (("left", 0.2), ("right", -0.2)):
        for name, height in (("elbow", 1.1), ("wrist", 0.85), ("hand", 0.78)):
            pose[NTU25.joints.index(f"{side}_{name}")] = (x, height, 0)
    return pose


def crowd(spread: float, seed: int, n_frames: int = N_FRAMES) -> np.ndarray:
    """Return bodies ``(T, J, 3)`` with errors of the trunk's joints, turned and shifted at random.

    Errors in the left hip are of three times the spread.
    """
    random = np.random.default_rng(seed)
    motion = np.repeat(body()[None], n_frames, axis=0)
    errors = spread * random.normal(size=(n_frames, len(JOINTS), 3))
    errors[:, JOINTS.index(NTU25.joints.index("left_hip"))] *= 3
    motion[:, JOINTS] += errors
    turns = Rotation.from_rotvec(random.uniform(0, 6, (n_frames, 1)) * [0, 1, 0]).as_matrix()
    return motion @ turns.swapaxes(1, 2) + random.normal(size=(n_frames, 1, 3))


def shapes(motion: np.ndarray) -> np.ndarray:
    """``(T, P)`` metres: all distances between the trunk's joints, which turns do not change."""
    trunk = motion[:, JOINTS]
    gaps = np.linalg.norm(trunk[:, :, None] - trunk[:, None], axis=-1)
    return gaps[:, *np.triu_indices(len(JOINTS), 1)]


def test_the_trunk_is_spine_head_shoulders_and_hips() -> None:
    assert {NTU25.joints[joint] for joint in JOINTS} == set(PLACES)
    assert {SBU15.joints[joint] for joint in trunk_joints(SBU15)} >= {"torso", "left_hip"}
    assert trunk_joints(make_interaction(np.random.default_rng(0)).skeleton) == ()


def test_shapes_get_the_distribution_of_captured_ones() -> None:
    captured = crowd(0.004, seed=1)
    model = learn_trunk([(crowd(0.03, seed=2), captured)], NTU25)
    new = crowd(0.03, seed=3)
    found = shape_trunk(new, NTU25, model)
    before, after, wanted = (shapes(motion).std(axis=0).mean() for motion in (new, found, captured))
    assert before > 4 * wanted
    assert after < 1.5 * wanted
    # Errors of 3 cm make a trunk larger by a few per cent, and its size is the generator's to say.
    means = [shapes(m).mean(axis=0) / trunk_size(m, NTU25) for m in (found, captured)]
    np.testing.assert_allclose(*means, atol=0.01)
    np.testing.assert_array_equal(found[:, LIMBS], new[:, LIMBS])
    # Where a trunk is, and where it faces, is the generator's to say.
    centres = [motion[:, JOINTS].mean(axis=1) for motion in (found, new)]
    np.testing.assert_allclose(*centres, atol=0.02)


def test_equal_distributions_change_nothing_and_few_frames_teach_nothing() -> None:
    captured = crowd(0.01, seed=1)
    model = learn_trunk([(captured, captured)], NTU25)
    np.testing.assert_allclose(shape_trunk(captured, NTU25, model), captured, atol=1e-9)
    few = captured[:20]
    np.testing.assert_array_equal(learn_trunk([(few, few)], NTU25), unshaped(NTU25))
    np.testing.assert_array_equal(learn_trunk([], NTU25), unshaped(NTU25))
    assert shape_trunk(few, NTU25, unshaped(NTU25)) is few


@pytest.mark.parametrize("scale", [0.6, 1.3])
def test_a_trunk_of_another_size_and_heading_is_shaped_alike(scale: float) -> None:
    model = learn_trunk([(crowd(0.03, seed=2), crowd(0.004, seed=1))], NTU25)
    new = crowd(0.03, seed=3, n_frames=50)
    turn = Rotation.from_euler("yx", [1.0, 0.2]).as_matrix()
    moved = scale * new @ turn.T + [1.0, 2.0, 3.0]
    expected = scale * shape_trunk(new, NTU25, model) @ turn.T + [1.0, 2.0, 3.0]
    np.testing.assert_allclose(shape_trunk(moved, NTU25, model), expected, atol=1e-9)
    # One frame of a clip is shaped as in the clip where its size is given.
    size = trunk_size(new, NTU25)
    np.testing.assert_allclose(
        shape_trunk(new[7:8], NTU25, model, size), shape_trunk(new, NTU25, model)[7:8], atol=1e-9
    )


def test_the_finish_keeps_a_pelvis_whole_while_a_foot_is_pulled() -> None:
    n_frames, pose = 60, body()
    given = np.repeat(pose[None], n_frames, axis=0)
    share = np.sin(np.pi * np.arange(n_frames) / (n_frames - 1)) ** 2
    ankle = NTU25.joints.index("left_ankle")
    # The foot is asked to be where the leg does not reach it, which draws the hip.
    given[:, [ankle, ankle + 1], 1] += 0.9 * share[:, None]
    given[:, [ankle, ankle + 1], 2] += 0.9 * share[:, None]
    partner = np.tile(pose[None] + np.array([0, 0, 2.5]), (n_frames, 1, 1)).astype(np.float32)
    found = finish(
        set_down(given, partner, 30.0, NTU25, ONE_FLOOR, np.zeros(n_frames, bool)).astype(
            np.float32
        ),
        partner,
        np.arange(n_frames) / 30,
        NTU25,
        nothing_learnt(NTU25),
    )
    np.testing.assert_allclose(shapes(found), shapes(given), atol=0.01)
