"""Truth: a motion that is moved by a known distance."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.commands.augment import read_solver_section
from pacmo_core.commands.captures import TwoPersonCapture
from pacmo_core.commands.measured import Measured, measure_written
from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.formats.registry import PersonMotion
from tests.commands.test_augment import CLIP

SECTION = read_solver_section(Path("params.yaml"))
A, B = (
    PersonMotion(CLIP.skeleton, CLIP.times, motion) for motion in (CLIP.person_a, CLIP.person_b)
)
DUO = TwoPersonCapture("one", (Path("one.npz"),), ({}, {}), (A, B))
SAME = np.ones(len(CLIP.skeleton.bones))


def lowered(person: PersonMotion, metres: float) -> PersonMotion:
    down = np.array([0, metres, 0], np.float32)
    return replace(person, motion=person.motion - down)


def measured(*people: tuple[PersonMotion, PersonMotion]) -> Measured:
    return measure_written(DUO, people, [(SAME, SAME)] * len(people), SECTION.solver)


@pytest.mark.parametrize(("person", "depths"), [("a", (0.05, 0.01)), ("b", (0.0, 0.05))])
def test_a_measurement_is_of_the_person_in_whom_it_is_worse(
    person: str, depths: tuple[float, float]
) -> None:
    found = measured((lowered(A, depths[0]), lowered(B, depths[1])))
    assert found.samples[0]["below_floor"] == pytest.approx(0.05, abs=1e-5)
    assert found.worse["below_floor"] == person
    line, *_ = (text for text in found.lines(SECTION.limits) if "below the floor" in text[:20])
    assert (
        line.split() == f"below the floor 5.00 cm wanted at most 1.00 cm, person {person}".split()
    )


def test_the_last_line_says_what_is_beyond_and_in_how_many() -> None:
    lines = list(measured((A, lowered(B, 0.05))).lines(SECTION.limits))
    head = lines.index("beyond the limits of what looks natural (augment.limits of params.yaml):")
    (depth,) = (line for line in lines[head + 1 :] if "below the floor" in line)
    frame, joint = np.unravel_index(B.motion[..., 1].argmin(), B.motion.shape[:2])
    time = CLIP.times[frame] - CLIP.times[0]
    assert depth == (
        "  below the floor 5.00 cm, wanted at most 1.00 cm (worst: person b, "
        f"{CLIP.skeleton.joints[joint]} in frame {frame} ({time:.2f} s))"
    )
    lines = list(measured((A, B), (A, lowered(B, 0.05))).lines(SECTION.limits))
    assert "means of 2 samples" in lines[0]
    (two,) = (line for line in lines if line.startswith("1 of 2 samples beyond the limits"))
    assert "below the floor (1)" in two
    assert f"  worst in sample 1: {depth.strip()}" in lines
    (*_, none) = measured((A, B)).lines(SECTION.limits)
    assert none == "all within the limits of what looks natural (augment.limits of params.yaml)"


def test_a_motion_that_is_the_capture_has_changed_by_nothing() -> None:
    found = measured((A, B))
    for text in (
        "near distances 0 mm",
        "no contacts to keep",
        "knees 0°",
        "below the floor 0 cm",
    ):
        assert any(" ".join(line.split()).startswith(text) for line in found.lines(SECTION.limits))


def test_a_bone_that_turns_and_a_joint_that_jumps_in_one_frame_are_named() -> None:
    joint = CLIP.skeleton.joints.index("left_hand")
    parent = CLIP.skeleton.parents[joint]
    motion = B.motion.copy()
    motion[:, joint] = motion[:, parent] + np.float32([0, -0.3, 0])
    still = replace(DUO, people=(A, replace(B, motion=motion)))
    motion = motion.copy()
    motion[7, joint] = motion[7, parent] + np.float32([0.3, 0, 0])
    jumps = [(A, still.people[1]), (A, replace(B, motion=motion))]
    found = measure_written(still, jumps, [(SAME, SAME)] * 2, SECTION.solver)
    turn, jolt = (
        text for text in found.lines(SECTION.limits) if "turn of a bone" in text or "jolt" in text
    )
    time = CLIP.times[7] - CLIP.times[0]
    assert turn == (
        "  largest added turn of a bone from one frame to the next: 90.0° in frame 7 "
        f"({time:.2f} s), 0° in the capture (sample 1, person b, bone to left_hand)"
    )
    assert "sample 1, person b has a jolt: left_hand accelerates by " in jolt
    assert f"in frame 7 ({time:.2f} s), wanted at most 150 (in the capture at most " in jolt
    same = measure_written(still, jumps[:1], [(SAME, SAME)], SECTION.solver)
    assert not same.peaks, "the capture itself has no added turn and no jolt"


def test_new_contacts_are_counted_beside_those_that_are_kept() -> None:
    b = replace(B, motion=B.motion + (A.motion - B.motion).mean(axis=(0, 1)) + np.float32(0.03))
    found = measured((A, B), (A, b))
    distances = [
        np.linalg.norm(A.motion[:, :, None] - person.motion[:, None], axis=-1) for person in (B, b)
    ]
    before, after = (values < SECTION.solver.contact_distance for values in distances)
    assert (found.contacts[0].kept, found.contacts[0].new) == (before.sum(), 0)
    assert found.contacts[1].kept == (before & after).sum()
    assert found.contacts[1].new == (after & ~before).sum() > 0
    (line,) = (text for text in found.lines(SECTION.limits) if "new contacts" in text)
    assert f"most {found.contacts[1].new:,} in sample 1" in line
    assert "that are kept (pairs of joints and frames)" in line


def test_bones_of_a_file_that_the_model_lacks_have_added_turns_too() -> None:
    names = (*CLIP.skeleton.joints, "right_pinky")
    parents = (*CLIP.skeleton.parents, CLIP.skeleton.joints.index("right_hand"))
    whole = Skeleton("whole", names, parents, mirror_by_name(names))

    def with_finger(person: PersonMotion) -> PersonMotion:
        tip = person.motion[:, [parents[-1]]] + np.float32([0.05, 0, 0])
        return PersonMotion(whole, person.times, np.concatenate([person.motion, tip], axis=1))

    bodies = with_finger(A), with_finger(B)
    turned = bodies[1].motion.copy()
    turned[7:, -1] += np.float32([-0.05, 0.05, 0])  # by a right angle
    in_files = [(bodies[0], replace(bodies[1], motion=turned))]
    duo = replace(DUO, bodies=bodies)
    scales = [(SAME, SAME)]
    found = measure_written(duo, [(A, B)], scales, SECTION.solver, in_files=in_files)
    (turn,) = found.peaks
    assert "from one frame to the next: 90.0° in frame 7 " in turn
    assert turn.endswith("0° in the capture (person b, bone to right_pinky)")
    assert not measure_written(duo, [(A, B)], scales, SECTION.solver).peaks


def test_each_person_is_displaced_by_what_was_added() -> None:
    root = CLIP.skeleton.root
    motion = A.motion.copy()
    motion[7, root] += np.float32([0, 0, 0.12])
    joint = CLIP.skeleton.joints.index("left_hand")
    motion[9, joint] += np.float32([0.3, 0, 0])
    scales = [(SAME, 1.1 * SAME)]
    found = measure_written(
        DUO, [(replace(A, motion=motion), lowered(B, 0.05))], scales, SECTION.solver
    )
    at_7, at_9 = (CLIP.times[frame] - CLIP.times[0] for frame in (7, 9))
    assert found.displaced[0] == (
        "  person a, whose body is the same, moves away from the capture by up to 30.0 cm "
        f"(left_hand in frame 9, {at_9:.2f} s), the pelvis by up to 12.0 cm "
        f"({CLIP.skeleton.joints[root]} in frame 7, {at_7:.2f} s)"
    )
    assert found.displaced[1].startswith("  person b moves away from the capture by up to 5.0 cm")
    assert all(line in found.lines(SECTION.limits) for line in found.displaced)
    assert "by up to 0.0 cm, the pelvis by up to 0.0 cm" in measured((A, B)).displaced[1]


def test_without_contacts_a_line_says_what_judges_a_grip() -> None:
    distances = np.linalg.norm(A.motion[:, :, None] - B.motion[:, None], axis=-1)
    frame, i, j = np.unravel_index(distances.argmin(), distances.shape)
    apart = B.motion[frame, j] - A.motion[frame, i]
    gap = (SECTION.solver.contact_distance + SECTION.solver.near_distance) / 2
    for wanted, is_near in ((gap, True), (SECTION.solver.near_distance + 3, False)):
        shift = apart * (wanted / np.linalg.norm(apart) - 1)
        b = replace(B, motion=B.motion + shift.astype(np.float32))
        found = measure_written(
            replace(DUO, people=(A, b)), [(A, b)], [(SAME, SAME)], SECTION.solver
        )
        (line,) = (text for text in found.lines(SECTION.limits) if "no contacts" in text)
        assert ("is judged by near distances, those within" in line) == is_near
