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
    (line,) = (text for text in found.lines(SECTION.limits) if "below the floor" in text[:20])
    assert (
        line.split() == f"below the floor 5.00 cm wanted at most 1.00 cm, person {person}".split()
    )


def test_the_last_line_says_what_is_beyond_and_in_how_many() -> None:
    (*_, one) = measured((A, lowered(B, 0.05))).lines(SECTION.limits)
    assert one.startswith(
        "beyond the limits of what looks natural (augment.limits of params.yaml): "
    )
    assert "below the floor 5.00 cm, wanted at most 1.00 cm" in one
    first, *_, two = measured((A, B), (A, lowered(B, 0.05))).lines(SECTION.limits)
    assert "means of 2 samples" in first
    assert two.startswith("1 of 2 samples beyond the limits")
    assert "below the floor (1)" in two
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
