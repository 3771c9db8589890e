"""Truth: a motion that is moved by a known distance."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.commands.augment import read_solver_section
from pacmo_core.commands.captures import TwoPersonCapture
from pacmo_core.commands.measured import Measured, measure_written
from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.formats.registry import PersonMotion
from tests.commands.test_augment import CLIP

SECTION = read_solver_section(Path("params.yaml"))
A, B = (
    PersonMotion(CLIP.skeleton, CLIP.times, motion) for motion in (CLIP.person_a, CLIP.person_b)
)
DUO = TwoPersonCapture("one", (Path("one.npz"),), ({}, {}), (A, B), (A, B))
SAME = np.ones(len(CLIP.skeleton.bones))


TURN = f"{25 * 30 / CLIP.fps:.1f}"  # degrees, the limit at this frame rate
assert TURN == "50.0"


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
    assert " ".join(line.split()).startswith(
        f"below the floor 5.00 cm wanted at most 1.00 cm, person {person}, from the capture's own "
        "lowest point, "
    )


def test_the_last_line_says_what_is_beyond_and_in_how_many() -> None:
    lines = list(measured((A, lowered(B, 0.05))).lines(SECTION.limits))
    head = lines.index(
        "beyond the limits of what looks natural (augment.limits of params.yaml, and those above):"
    )
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
    assert none == (
        "all within the limits of what looks natural (augment.limits of params.yaml, and those "
        "above); errors of joints against the exact motion have none"
    )


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
    time = CLIP.times[7] - CLIP.times[0]
    lines = [" ".join(line.split()) for line in found.lines(SECTION.limits)]
    (turn,) = (line for line in lines if line.startswith("turn of a bone"))
    assert turn.endswith(
        f"wanted at most {TURN}° from one frame to the next, 0° in the capture (person b, bone to "
        f"left_hand in frame 7 ({time:.2f} s)), worst 90.0° in sample 1"
    )
    (jolt,) = (line for line in lines if line.startswith("joint acceleration"))
    assert re.search(
        rf"wanted at most 150 m/s², at most \d+ m/s² in the capture \(person b, left_hand in frame "
        rf"7 \({time:.2f} s\)\), worst [\d,]+ m/s² in sample 1",
        jolt,
    )
    (beyond,) = (line for line in lines if line.startswith("1 of 2 samples beyond"))
    assert "turn of a bone (1)" in beyond and "joint acceleration (1)" in beyond
    assert any(line.startswith("worst in sample 1: turn of a bone 90.0°, wanted") for line in lines)
    (*_, none) = measure_written(still, jumps[:1], [(SAME, SAME)], SECTION.solver).lines(
        SECTION.limits
    )
    assert none.startswith("all within"), "the capture itself has no turn and no jolt"


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


@pytest.mark.parametrize(("apart", "kept"), [(0.0, True), (0.25, False)])
def test_lost_contacts_call_for_the_solver(apart: float, kept: bool) -> None:
    hand, other = CLIP.skeleton.indices(["left_hand", "right_hand"])
    to_hand = A.motion[:, [hand]] - B.motion[:, [other]]
    meets, moved = (
        replace(B, motion=B.motion + to_hand + np.float32([0.05 + x, 0, 0])) for x in (0, apart)
    )
    duo = replace(DUO, people=(A, meets), bodies=(A, meets))
    child = (SAME, 0.3 * SAME)  # only scaled, near distances would change more
    found = measure_written(duo, [(A, moved)], [child], SECTION.solver)
    lines = list(found.lines(SECTION.limits, "do"))
    assert any("contacts kept" in line for line in lines)
    assert ("  do" in lines) == (not kept)


def with_finger(person: PersonMotion, length: float, *turns: float) -> PersonMotion:
    """Add an End Site beyond the right hand that is turned by degrees from frame 7 on."""
    names = (*CLIP.skeleton.joints, "right_pinky_end")
    parents = (*CLIP.skeleton.parents, CLIP.skeleton.joints.index("right_hand"))
    whole = Skeleton("whole", names, parents, mirror_by_name(names))
    tips = np.tile(np.float32([length, 0, 0]), (len(person.times), 1, 1))
    for turn in turns:
        angle = np.radians(turn)
        tips[7:] = np.float32([length * np.cos(angle), length * np.sin(angle), 0])
    motion = np.concatenate([person.motion, person.motion[:, [parents[-1]]] + tips], axis=1)
    return PersonMotion(whole, person.times, motion)


@pytest.mark.parametrize("length", [0.05, 0.014])
@pytest.mark.parametrize(
    ("captured", "written", "limit"), [(0, 80, 50), (60, 90, 78), (60, 75, 0), (0, 49, 0)]
)
def test_an_end_site_that_pops_is_beyond_a_limit_beside_what_the_capture_has(
    length: float, captured: float, written: float, limit: float
) -> None:
    duo = replace(DUO, bodies=(with_finger(A, length), with_finger(B, length, captured)))
    in_files = [(with_finger(A, length), with_finger(B, length, written))]
    scales = [(SAME, SAME)]
    found = measure_written(duo, [(A, B)], scales, SECTION.solver, in_files=in_files)
    time = CLIP.times[7] - CLIP.times[0]
    place = f"frame 7 ({time:.2f} s)"
    lines = list(found.lines(SECTION.limits))
    said = (
        f"  turn of a bone {written:.1f}°, wanted at most {limit:.1f}° from one frame to the next, "
        f"{format_fixed(captured, 1)}° in the capture (worst: person b, bone to right_pinky_end in "
        f"{place})"
    )
    assert (said in lines) == bool(limit)
    assert any(line.startswith("all within the limits") for line in lines) != bool(limit)
    own = (
        f"  the capture itself turns a bone of person b by {captured:.1f}° in {place} (to "
        f"right_pinky_end, {written:.1f}° in what was written): if it jumps there, mend the capture"
    )
    assert (own in lines) == (captured > 50)
    lacks = measure_written(duo, [(A, B)], scales, SECTION.solver)  # as Parquet
    assert list(lacks.lines(SECTION.limits))[-1].startswith("all within")


def test_an_end_site_that_the_capture_lacks_turns_with_the_bone_that_carries_it() -> None:
    motion = B.motion.copy()
    hand, elbow = (CLIP.skeleton.joints.index(f"right_{name}") for name in ("hand", "elbow"))
    motion[:, hand] = motion[:, elbow] + np.float32([0.2, 0, 0])
    motion[7:, hand] = motion[7:, elbow] + np.float32([0, 0.2, 0])  # by a right angle
    b = replace(B, motion=motion)
    in_files = [(with_finger(A, 0.02), with_finger(b, 0.02, 90))]
    found = measure_written(
        replace(DUO, people=(A, b)), [(A, b)], [(SAME, SAME)], SECTION.solver, in_files=in_files
    )
    assert found.checks[0]["turn"].captured == "90.0° in the capture"
    assert "all within" in list(found.lines(SECTION.limits))[-1]


def test_a_toe_tip_below_the_floor_is_compared_with_that_of_the_capture() -> None:
    lowest = min(A.motion[..., 1].min(), B.motion[..., 1].min())

    def toe(person: PersonMotion, depth: float) -> PersonMotion:
        whole = with_finger(person, 0.05)
        motion = whole.motion.copy()
        motion[7, -1, 1] = lowest - depth
        return replace(whole, motion=motion)

    for own, depth in ((0.0, 0.015), (0.02, 0.035), (0.02, 0.025)):
        on_rigs = (Path("a.bvh"), Path("b.bvh"))
        duo = replace(DUO, files=on_rigs, bodies=(toe(A, own), toe(B, own)))
        found = measure_written(
            duo, [(A, B)], [(SAME, SAME)], SECTION.solver, in_files=[(toe(A, own), toe(B, depth))]
        )
        assert found.samples[0]["below_floor"] == pytest.approx(depth - own, abs=1e-5)
        lines = list(found.lines(SECTION.limits))
        (said,) = (line for line in lines if line.startswith("  below the floor    "))
        ground = np.median(np.concatenate([p.motion[..., 1] for p in duo.whole], 1).min(axis=1))
        assert said.endswith(
            "person b, from the capture's own lowest point, "
            f"{100 * (ground - lowest + own):.2f} cm below its floor"
        )
        place = f"person b, right_pinky_end in frame 7 ({CLIP.times[7] - CLIP.times[0]:.2f} s)"
        faults = [line for line in lines if line.startswith("  below the floor 1.50 cm, wanted")]
        assert bool(faults) == (depth - own > 0.01)
        assert all(place in fault for fault in faults)


def test_near_distances_that_are_worse_than_scaled_are_said_with_pairs_and_what_to_do() -> None:
    j = CLIP.skeleton.joints.index("left_hand")
    distances = np.linalg.norm(A.motion - B.motion[:, [j]], axis=-1)
    frame, i = np.unravel_index(distances.argmin(), distances.shape)
    apart = B.motion[frame, j] - A.motion[frame, i]
    shift = apart * (0.2 / np.linalg.norm(apart) - 1)
    near = replace(B, motion=B.motion + shift.astype(np.float32))
    duo = replace(DUO, people=(A, near))
    motion = near.motion.copy()
    motion[:, j] += (0.3 * apart / np.linalg.norm(apart)).astype(np.float32)
    away = replace(near, motion=motion)
    for people, where in (
        ([(A, away)], ""),
        ([(A, away)] * 2, " in all 2 samples, which are alike,"),
        ([(A, near), (A, away)], " in 1 of 2 samples, most in sample 1,"),
    ):
        found = measure_written(duo, people, [(SAME, SAME)] * len(people), SECTION.solver)
        lines = list(found.lines(SECTION.limits, "use the solver"))
        (row,) = (line for line in lines if line.startswith("  near distances"))
        assert "0 mm if only scaled, no limit" in row
        (at,) = (n for n, line in enumerate(lines) if line.startswith("near distances"))
        assert lines[at - 1].endswith("; near distances have none, see below")
        assert lines[at].startswith(
            "near distances, which have no limit, change more than if each body is only scaled:"
            f"{where} by "
        )
        names = CLIP.skeleton.joints
        assert f"  {names[i]} of person a and {names[j]} of b, " in "".join(lines[at + 1 :])
        assert lines[-1] == "  use the solver"
    same = measure_written(duo, [(A, near)], [(SAME, SAME)], SECTION.solver)
    assert "use the solver" not in "".join(same.lines(SECTION.limits, "use the solver"))


def test_samples_that_are_alike_have_no_worst() -> None:
    lines = list(measured((A, lowered(B, 0.05)), (A, lowered(B, 0.05))).lines(SECTION.limits))
    assert lines[0].endswith("; the 2 samples are alike:")
    said = "\n".join(lines)
    assert "worst in" not in said and "of sample" not in said and "in sample" not in said
    assert "all 2 samples beyond the limits" in said and "  alike in all samples: below" in said
    some = "\n".join(
        measured((A, B), (A, lowered(B, 0.05)), (A, lowered(B, 0.05))).lines(SECTION.limits)
    )
    assert "worst 5.00 cm in samples 1, 2" in some and "alike in all samples" in some
    assert "  worst in samples 1, 2: below the floor 5.00 cm" in some


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
