"""Truth: one joint of one person that is moved, in a frame that is known."""

import numpy as np
import pytest

from pacmo_core.api import synthesise
from pacmo_core.commands.places import Places
from pacmo_core.interaction_mesh import Scene

CLIP = next(iter(synthesise(1).values()))
SKELETON = CLIP.skeleton
N = len(SKELETON.joints)
FRAME = 7
SCENE = Scene((CLIP.person_a, CLIP.person_b), (SKELETON, SKELETON), CLIP.fps)
ALL = np.ones(SCENE.points.shape[:2], np.bool_)
UP, ASIDE = np.array([0.0, 1, 0]), np.array([0.6, 0, 0.8])
AT = f"in frame {FRAME} ({FRAME / SCENE.fps:.2f} s)"


def point(joint: str, person: int = 1) -> int:
    return N * person + SKELETON.joints.index(joint)


def places(motion: np.ndarray, scene: Scene = SCENE, **worse: int) -> Places:
    return Places(scene, ALL, np.ones(len(scene.bones)), motion, 0.1, 0.25, worse)


@pytest.mark.parametrize(
    ("name", "joint", "by", "where"),
    [
        ("spine_bend", "spine_mid", 0.1 * ASIDE, "spine_mid"),
        ("spine_change_p95", "spine_mid", 0.1 * ASIDE, "spine_mid"),
        ("knee_change_p95", "left_ankle", 0.2 * UP + 0.2 * ASIDE, "left_knee"),
        ("elbow_change_p95", "right_wrist", 0.2 * ASIDE, "right_elbow"),
        ("pelvis_height_error", "spine_base", 0.2 * UP, "spine_base"),
        ("support_height_error", "right_foot", 0.3 * UP, "right_foot"),
        ("peak_acceleration_ratio", "head", 0.5 * ASIDE, "head"),
        ("seam_ratio", "head", 0.5 * ASIDE, "head"),
    ],
)
@pytest.mark.parametrize("person", [0, 1])
def test_a_joint_that_is_moved_in_one_frame_is_the_place(
    name: str, joint: str, by: np.ndarray, where: str, person: int
) -> None:
    motion = SCENE.points.copy()
    motion[FRAME, point(joint, person)] += by
    assert places(motion).text(name) == f"person {'ab'[person]}, {where} {AT}"


def test_a_foot_skates_in_the_frame_in_which_it_is_elsewhere() -> None:
    motion = SCENE.points.copy()
    motion[FRAME:, point("right_ankle")] += 0.3 * ASIDE
    assert places(motion).text("added_foot_skate") == f"person b, right_ankle {AT}"


def test_the_place_is_in_the_person_in_whom_the_measurement_is_worse() -> None:
    motion = SCENE.points.copy()
    motion[FRAME, point("spine_base", 0)] += 0.3 * UP
    motion[9, point("spine_base", 1)] += 0.4 * UP
    found = places(motion, pelvis_height_error=0).text("pelvis_height_error")
    assert found == f"person a, spine_base {AT}"


def test_near_pairs_that_change_more_than_by_scaling_are_named_the_worst_first() -> None:
    captured = SCENE.points.copy()
    hands = [point("left_hand", 0), point("right_hand", 0)], [point("left_hand"), point("head")]
    for a, b in zip(*hands, strict=True):
        captured[:, b] = captured[:, a] + 0.2 * ASIDE
    a, b = np.split(captured.astype(np.float32), 2, axis=1)
    scene = Scene((a, b), SCENE.skeletons, SCENE.fps)
    motion = captured.copy()
    motion[9, hands[1][0]] += 0.1 * ASIDE
    motion[FRAME, hands[1][1]] += 0.3 * ASIDE
    first, second, *_ = places(motion, scene).near_pairs()
    assert first == (
        f"right_hand of person a and head of b, 50.0 cm apart {AT}, 20.0 cm in the capture, "
        "20.0 cm if only scaled"
    )
    assert second.startswith("left_hand of person a and left_hand of b, 30.0 cm apart in frame 9 ")
    assert not places(captured, scene).near_pairs()


def test_a_lost_contact_has_both_joints() -> None:
    motions = SCENE.points.copy()
    motions[FRAME, point("left_hand")] = motions[FRAME, point("right_hand", 0)]
    a, b = np.split(motions.astype(np.float32), 2, axis=1)
    scene = Scene((a, b), SCENE.skeletons, SCENE.fps)
    motion = motions.copy()
    motion[FRAME, point("left_hand")] += 5 * UP
    found = places(motion, scene).text("contacts_kept")
    assert " of person a and left_hand of b, 5" in found
    assert found.endswith(AT)
    assert not places(motions, scene).text("contacts_kept"), "none is lost"


def test_bodies_are_deepest_in_the_frame_in_which_a_hand_is_in_the_other() -> None:
    motion = SCENE.points.copy()
    motion[FRAME, point("left_hand_tip")] = motion[FRAME, point("spine_mid", 0)]
    found = places(motion).text("capsule_penetration")
    assert found.startswith("bones to spine_")
    assert found.endswith(f"of person a and left_hand_tip of b {AT}")


def test_a_trunk_that_changes_throughout_has_two_joints_and_no_frame() -> None:
    motion = SCENE.points.copy()
    motion[:, point("left_hip")] += 0.3 * ASIDE
    found = places(motion).text("trunk_change")
    assert found.startswith("person b, ")
    assert "left_hip" in found and "frame" not in found


def test_a_flip_has_the_first_frame_of_the_person() -> None:
    a, b = (motion.copy() for motion in (CLIP.person_a, CLIP.person_b))
    shoulder, elbow, wrist = (SKELETON.joints.index(f"left_{j}") for j in
                              ("shoulder", "elbow", "wrist"))  # fmt: skip
    b[:, elbow] = b[:, shoulder] + np.float32([0, -0.28, 0])
    b[:, wrist] = b[:, elbow] + np.float32([0.2, 0, 0])
    scene = Scene((a, b), SCENE.skeletons, SCENE.fps)
    motion = scene.points.copy()
    motion[FRAME:, N + wrist] -= [0.4, 0, 0]
    found = places(motion, scene, elbow_flips=1).text("elbow_flips")
    assert found == f"person b, first {AT}"


def test_what_is_of_the_solver_has_no_place() -> None:
    assert not places(SCENE.points).text("primal_residual")
