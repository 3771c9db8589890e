"""Truth: no joint of a finished motion is much faster than the motion given, no knee bends back."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import NTU25, SBU15, Skeleton
from pacmo_core.finish.bones import median_lengths, set_legs
from pacmo_core.finish.finish import finish
from pacmo_core.finish.learnt import nothing_learnt
from pacmo_core.finish.steps import MAX_SPEED, take_steps
from pacmo_core.reaction.inference import PACKAGED
from pacmo_core.store.motions import stream_motions
from tests.finish.test_floor import LEG, standing
from tests.finish.test_steps import FEET, FPS, LENGTHS, crouching, glide, turned
from tests.formats.real_files import real_folder
from tests.reaction.problems import REST


def peak_speed(motion: Motion, fps: float = FPS) -> float:
    """Metres per second, of the fastest joint."""
    return float(np.linalg.norm(np.diff(motion, axis=0), axis=-1).max() * fps)


def bends(motion: Motion, skeleton: Skeleton) -> np.ndarray:
    """``(T, 2)`` metres: how far each knee is ahead of the line from its hip to its ankle.

    Ahead is what the hips face, at right angles to the line.
    """
    found = []
    hips = [skeleton.parents[skeleton.parents[foot[0]]] for foot in feet(skeleton)]
    left, right = sorted(hips, key=lambda hip: "left" not in skeleton.joints[hip])
    facing = np.cross(motion[:, left] - motion[:, right], [0.0, 1.0, 0.0])
    for hip, (ankle, *_) in zip(hips, feet(skeleton), strict=True):
        line = motion[:, ankle] - motion[:, hip]
        line /= np.linalg.norm(line, axis=-1, keepdims=True)
        ahead = facing - (facing * line).sum(axis=-1, keepdims=True) * line
        ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
        knee = motion[:, skeleton.parents[ankle]] - motion[:, hip]
        found.append((knee * ahead).sum(axis=-1))
    return np.stack(found, axis=1)


def straight_glide(metres: float, turn: float = 0.0, seconds: float = 2.0) -> np.ndarray:
    """Glide as ``glide`` does, with nearly straight legs."""
    times = np.arange(round((2 + seconds) * FPS)) / FPS
    share = ((times - 1) / seconds).clip(0, 1)
    share = share**2 * (3 - 2 * share)
    pose = 0.05 * crouching() + 0.95 * REST
    motion = turned(np.tile(pose, (len(times), 1, 1)), turn * share)
    motion[..., 2] += metres * share[:, None]
    return motion


@pytest.mark.parametrize("angle", [-0.6, -0.3, 0.0, 0.3, 0.6])
def test_a_knee_turns_with_the_line_from_hip_to_ankle(angle: float) -> None:
    """The whole leg is turned: the knee is where it is turned to, wherever the foot is put."""
    hip, knee, ankle, foot = NTU25.indices(["left_hip", "left_knee", "left_ankle", "left_foot"])
    motion = standing(LEG).astype(np.float64)
    lengths = median_lengths(motion.astype(np.float32), NTU25)
    nowhere = np.full(motion.shape[:2], -np.inf)
    bent = motion.copy()
    bent[:, [ankle, foot], 1] += 0.03
    set_legs(motion, bent, nowhere, lengths, NTU25)
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    whole = motion.copy()
    leg = [knee, ankle, foot]
    whole[:, leg] = whole[:, [hip]] + (whole[:, leg] - whole[:, [hip]]) @ turn.T
    found = motion.copy()
    set_legs(found, whole, nowhere, lengths, NTU25)
    np.testing.assert_allclose(found[:, leg], whole[:, leg], atol=1e-5)


@pytest.mark.parametrize(("metres", "turn"), [(1.5, 0.0), (0.6, np.pi), (0.8, 1.0), (-1.0, 0.5)])
@pytest.mark.parametrize("make", [glide, straight_glide])
def test_no_joint_is_too_fast_in_steps(make, metres, turn) -> None:
    given = make(metres, turn)
    found = take_steps(given, LENGTHS, FPS, SBU15)
    assert np.abs(found - given)[:, FEET].max() > 0.1  # there are steps
    assert peak_speed(found) < MAX_SPEED + 0.01


def test_a_body_too_fast_for_steps_glides_on() -> None:
    given = straight_glide(6.0, 0.0, 1.0)
    assert peak_speed(given) > 1.5 * MAX_SPEED
    found = take_steps(given, LENGTHS, FPS, SBU15)
    assert peak_speed(found) < peak_speed(given) + 0.1


def test_legs_outside_of_a_glide_are_left_as_they_were_without_a_jump() -> None:
    given = glide(1.5)
    stretched = given.copy()
    legs = [SBU15.parents[FEET[0]], SBU15.parents[FEET[1]], *FEET]
    stretched[:, legs, 1] -= 0.06  # bones of other lengths than their medians
    found = take_steps(stretched, LENGTHS, FPS, SBU15)
    assert peak_speed(found) < MAX_SPEED + 0.01
    np.testing.assert_array_equal(found[:10], stretched[:10])


@pytest.mark.parametrize("metres", [1.0, 2.0])
def test_a_finished_glide_is_smooth(metres: float) -> None:
    given = straight_glide(metres, 1.0).astype(np.float32)
    partner = np.tile(REST + np.array([0, 0, 5.0]), (len(given), 1, 1)).astype(np.float32)
    times = np.arange(len(given)) / FPS
    found = finish(given, partner, times, SBU15, nothing_learnt(SBU15)).astype(np.float64)
    assert peak_speed(found) < 1.3 * max(peak_speed(given), MAX_SPEED)
    assert bends(found, SBU15).min() > -5e-3


@pytest.mark.parametrize("side", ["S1", "S2"])
def test_reactions_to_a_real_greeting_are_finished_without_a_jump(
    side: str, tmp_path: Path
) -> None:
    """People approach, embrace, part and turn: generated feet glide, and turns collapse."""
    file = real_folder("duo_mocap") / "acts" / f"greeting002_{side}_30fps.bvh"
    words = ["react", str(file), "--samples", "2", "--weights", str(PACKAGED)]
    stored = [tmp_path / name for name in ("generated.parquet", "finished.parquet")]
    for out, more in zip(stored, (["--no-finish"], []), strict=True):
        said = CliRunner().invoke(app, [*words, "--out", str(out), *more])
        assert said.exit_code == 0, said.output
    generated, finished = (dict(stream_motions(out)) for out in stored)
    for name, clip in finished.items():
        before, after = (pair.person_b.astype(np.float64) for pair in (generated[name], clip))
        assert peak_speed(after) < 1.3 * peak_speed(before) + 1.0, name
        assert bends(after, clip.skeleton).min() > -5e-3, name
