"""Truth: a joint that jumps, feet that glide and bodies that overlap by known amounts."""

import numpy as np

from pacmo_core.api import synthesise
from pacmo_core.commands.reaction_checks import motion_lines
from pacmo_core.interaction_mesh.body_parts import capsule_radii
from pacmo_core.interaction_mesh.scene import Scene

TIMES = np.arange(60) / 30
CLIP = next(iter(synthesise(1).values()))
SKELETON = CLIP.skeleton


def standing() -> np.ndarray:
    """``(T, J, 3)`` float32: a person who stands still at the origin."""
    pose = CLIP.person_a[0]
    pose = pose - pose[SKELETON.root] * [1, 0, 1]
    return np.repeat(pose[None], len(TIMES), axis=0).astype(np.float32)


def test_a_still_reaction_has_no_fault() -> None:
    partner = standing()
    (line,) = motion_lines(SKELETON, TIMES, partner, (partner + np.float32([2, 0, 0]))[None])
    assert "the slower foot moves at 0 cm/s on average (the partner's at 0)" in line
    assert "the bodies are at most 0 cm deep in each other" in line


def test_the_sample_whose_joint_jumps_is_named() -> None:
    partner = standing()
    still = partner + np.float32([2, 0, 0])
    jumps = still.copy()
    jumps[12:, 1, 2] += 0.4  # 0.4 m in 1/30 s: 12 m/s from rest in 1/30 s
    _, fault, hint = motion_lines(SKELETON, TIMES, partner, np.stack([still, jumps]))
    assert fault.startswith("sample 1 has a jolt: a joint accelerates by 360 m/s²")
    assert hint == "another --seed gives other samples"


def test_feet_that_glide_have_their_speed() -> None:
    partner = standing()
    glides = partner + np.float32([2, 0, 0])
    glides[..., 0] += 0.25 * TIMES[:, None]
    (line,) = motion_lines(SKELETON, TIMES, partner, glides[None])
    # The kernel reflects at both ends, where a motion of constant speed slows down.
    speed = float(line.split("moves at ")[1].split(" cm/s")[0])
    assert 22 < speed <= 25


def test_bodies_in_one_place_are_as_deep_as_the_widest_capsule() -> None:
    partner = standing()
    meets = partner + np.float32([2, 0, 0])
    meets[40] = partner[40]
    radii = capsule_radii(Scene((partner, partner), (SKELETON, SKELETON), 30.0))
    lines = motion_lines(SKELETON, TIMES, partner, meets[None])
    deep = f"sample 0: the bodies are {200 * radii.max():.1f} cm deep in each other at 1.33 s"
    assert lines[1].startswith(deep)
