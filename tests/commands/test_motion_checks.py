"""Truth: a joint that jumps, feet that glide and bodies that overlap by known amounts."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pacmo_core.api import synthesise
from pacmo_core.commands.motion_checks import (
    _mean_speed,
    _most_alike,
    motion_lines,
)
from pacmo_core.commands.peaks import angles, find_peak, joint_accelerations
from pacmo_core.commands.sample_table import RIGHT_ACTION, Measurement
from pacmo_core.data.interaction import Motion
from pacmo_core.data.posture import measure_posture
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.finish.floor import find_floor
from pacmo_core.finish.stance import find_stance
from pacmo_core.formats.registry import PersonMotion
from pacmo_core.interaction_mesh.body_parts import capsule_radii
from pacmo_core.interaction_mesh.scene import Scene

TIMES = np.arange(60) / 30
CLIP = next(iter(synthesise(1).values()))
SKELETON = CLIP.skeleton


def lines_of(partner: Motion, samples: Motion) -> list[str]:
    people = [PersonMotion(SKELETON, TIMES, motion) for motion in (partner, *samples)]
    return joined(motion_lines(SKELETON, TIMES, partner, samples, people))


def joined(lines: list[str]) -> list[str]:
    """Join the lines of all samples; those on what is beyond a limit follow, if anything is."""
    head = "the motion of the reaction, measured in what was written (docs/react.md)"
    assert lines[0].startswith(head) and lines[0].endswith(":")
    measured = [line for line in lines[1:] if line.startswith("  ")]
    assert lines[1 : 1 + len(measured)] == measured
    verdict = lines[1 + len(measured) :]
    assert verdict
    within = r"within every limit: (the reaction|both samples|all \d+ samples)"
    if re.fullmatch(
        f"{within}(; (in samples? [0-9, ]+ )?no hand touches the other person)?; {RIGHT_ACTION}",
        verdict[-1],
    ):
        # Lines on the partner and on sizes may come before.
        verdict = verdict[:-1]
    return ["\n".join(measured), *verdict]


def row(table: str, name: str) -> list[str]:
    """Return the cells of a row: wanted and partner where it has them, then samples."""
    (line,) = (line for line in table.splitlines() if line.strip().startswith(name))
    return line.strip().removeprefix(name).split()


def standing() -> np.ndarray:
    """``(T, J, 3)`` float32: a person who stands still at the origin."""
    pose = CLIP.person_a[0]
    pose = pose - pose[SKELETON.root] * [1, 0, 1]
    return np.repeat(pose[None], len(TIMES), axis=0).astype(np.float32)


def test_a_still_reaction_has_no_fault() -> None:
    partner = standing()
    (line,) = lines_of(partner, (partner + np.float32([2, 0, 0]))[None])
    assert row(line, "slower foot, cm/s") == ["<=", "30", "0", "0"]
    assert row(line, "bodies in each other, cm") == ["<=", "8", "0"]
    assert row(line, "pelvises apart at least, m") == ["2.00"]
    stature, own = row(line, "stature by the legs, m")
    assert stature == own
    assert 1.5 < float(own) < 2.0


def test_it_is_said_how_near_people_come_and_how_long_a_hand_touches() -> None:
    partner = standing()
    far = partner + np.float32([2, 0, 0])
    hand, head = SKELETON.indices(["left_hand", "head"])
    far[:, hand] = partner[:, head] + np.float32([0, 0.5, 0])
    near = far.copy()
    near[20:27, hand] = partner[20:27, head] + np.float32([0, 0.099, 0])
    near[23, hand] = partner[23, head] + np.float32([0, 0.05, 0])
    line = lines_of(partner, far[None])[0]
    assert row(line, "nearest joints apart, cm") == ["50.0"]
    assert row(line, "frames of 60: a hand to the partner's body") == ["0"]
    line = lines_of(partner, np.stack([far, near]))[0]
    assert row(line, "nearest joints apart, cm") == ["50.0", "5.0"]
    assert row(line, "frames of 60: a hand to the partner's body") == ["0", "7"]
    near[30:33, hand] = partner[30:33, SKELETON.joints.index("right_wrist")] + np.float32(
        [0, 0, 0.05]
    )
    near[40:42, hand] = partner[40:42, hand] + np.float32([0, 0, 0.02])
    line = lines_of(partner, np.stack([far, near]))[0]
    assert row(line, "frames of 60: a left hand to a right") == ["0", "3"]
    assert row(line, "frames of 60: left hand to left") == ["0", "2"]
    assert row(line, "frames of 60: right hand to right") == ["0", "0"]


def test_more_samples_than_columns_have_the_least_and_the_greatest() -> None:
    partner = standing()
    motions = np.stack([partner + np.float32([1 + n, 0, 0]) for n in range(9)])
    line = lines_of(partner, motions)[0]
    assert line.splitlines()[0].split() == ["wanted", "partner", "least", "greatest", "of", "9"]
    assert row(line, "pelvises apart at least, m") == ["1.00", "9.00"]


def test_a_trunk_leans_by_its_angle_from_the_vertical() -> None:
    partner = standing()
    turned = Rotation.from_euler("x", 20, degrees=True).apply(partner.reshape(-1, 3))
    leans = turned.reshape(partner.shape).astype(np.float32) + np.float32([2, 0, 0])
    own, found = row(lines_of(partner, leans[None])[0], "lean of the trunk, °")
    assert float(found) == pytest.approx(20, abs=float(own) + 1)
    assert float(own) < 8


def test_the_verdict_says_that_no_hand_touches() -> None:
    partner = standing()
    far = partner + np.float32([2, 0, 0])
    hand, head = SKELETON.indices(["left_hand", "head"])
    near = far.copy()
    near[:, hand] = partner[:, head] + np.float32([0, 0.09, 0])
    people = [PersonMotion(SKELETON, TIMES, partner), PersonMotion(SKELETON, TIMES, far)]
    for motion, without in ((far, "; no hand touches the other person"), (near, "")):
        lines = motion_lines(SKELETON, TIMES, partner, motion[None], people)
        within = f"within every limit: the reaction{without}"
        assert lines[-1] == f"{within}; {RIGHT_ACTION}"
    people = [*people, people[1]]
    lines = motion_lines(SKELETON, TIMES, partner, np.stack([near, far]), people)
    without = "; in sample 1 no hand touches the other person"
    within = f"within every limit: both samples{without}"
    assert lines[-1] == f"{within}; {RIGHT_ACTION}"


def test_a_touch_of_heads_is_none_of_hands() -> None:
    partner = standing()
    meets = partner + np.float32([2, 0, 0])
    head = SKELETON.joints.index("head")
    meets[:, head] = partner[:, head] + np.float32([0, 0.04, 0])
    line = lines_of(partner, meets[None])[0]
    assert row(line, "nearest joints apart, cm") == ["4.0"]
    assert row(line, "frames of 60: a hand to the partner's body") == ["0"]


def test_the_sample_whose_joint_jumps_is_named() -> None:
    partner = standing()
    still = partner + np.float32([2, 0, 0])
    jumps = still.copy()
    jumps[12:, 1, 2] += 0.4  # 0.4 m in 1/30 s: 12 m/s from rest in 1/30 s
    _, fault, *_, hint = lines_of(partner, np.stack([still, jumps]))
    joint = SKELETON.joints[1]
    assert fault == (
        f"sample 1: a joint accelerates by 360 m/s², {joint} in frame 11 (0.37 s), wanted at most "
        "150 m/s²"
    )
    untouched = "no hand touches the other person"
    assert hint == f"within every limit: sample 0; {untouched}; another --seed gives other samples"


def test_feet_that_glide_have_their_speed() -> None:
    partner = standing()
    glides = partner + np.float32([2, 0, 0])
    glides[..., 0] += 0.25 * TIMES[:, None]
    (line,) = lines_of(partner, glides[None])
    # The kernel reflects at both ends, where a motion of constant speed slows down.
    speed = float(row(line, "slower foot, cm/s")[-1])
    assert 22 < speed <= 25


def test_bodies_in_one_place_are_as_deep_as_the_widest_capsule() -> None:
    partner = standing()
    meets = partner + np.float32([2, 0, 0])
    meets[40] = partner[40]
    radii = capsule_radii(Scene((partner, partner), (SKELETON, SKELETON), 30.0))
    lines = lines_of(partner, meets[None])
    assert lines[1].startswith(
        f"sample 0: the bodies are {200 * radii.max():.1f} cm deep in each other, bones to "
        "spine_mid and the partner's spine_mid in frame 40 (1.33 s)"
    )
    assert lines[-1].startswith(
        "another --seed gives another sample; where --samples 3 are all beyond"
    )


def test_the_largest_turn_of_a_bone_has_joint_frame_and_time() -> None:
    partner = standing()
    turns = partner + np.float32([2, 0, 0])
    child = SKELETON.joints.index("left_ankle")
    bone = turns[:, child] - turns[:, SKELETON.parents[child]]
    length = np.linalg.norm(bone[0])
    # The shin turns by 26 degrees about x in frame 18, 0.6 s, and stays there.
    side = np.cross([1.0, 0, 0], bone[0])
    axis = np.cross(bone[0], side) / np.linalg.norm(np.cross(bone[0], side))
    angle = np.radians(26.0)
    turned = bone[0] * np.cos(angle) + np.cross(axis, bone[0]) * np.sin(angle)
    assert np.isclose(np.linalg.norm(turned), length, atol=1e-6)
    moved = turns.copy()
    moved[18:, child] += (turned - bone[0]).astype(np.float32)
    foot = SKELETON.joints.index("left_foot")
    moved[18:, foot] += (turned - bone[0]).astype(np.float32)
    first, *faults = lines_of(partner, np.stack([turns, moved]))
    assert row(first, "turn of a bone in 1/30 s, °") == ["<=", "25", "0", "0", "26.0"]
    assert faults[-2] == (
        "sample 1: a bone turns by 26.0° from one frame to the next, that to left_ankle in frame "
        "18 (0.60 s), wanted at most 25°"
    )


def test_a_slower_foot_beyond_its_limit_is_named_with_its_sample() -> None:
    partner = standing()
    still = partner + np.float32([2, 0, 0])
    glides = still.copy()
    glides[..., 0] += 0.4 * TIMES[:, None]
    _, fault, _ = lines_of(partner, np.stack([still, glides]))
    assert fault.startswith("sample 1: the slower foot moves at 3")
    assert fault.endswith(" cm/s on average, wanted at most 30 cm/s")


def test_bones_of_the_file_that_the_model_lacks_have_turns_too() -> None:
    partner = standing()
    still = partner + np.float32([2, 0, 0])
    names = (*SKELETON.joints, "right_pinky")
    parents = (*SKELETON.parents, SKELETON.joints.index("right_hand"))
    whole = Skeleton("whole", names, parents, mirror_by_name(names))
    tips = still[:, [parents[-1]]] + np.float32([0.15, 0, 0])
    tips[30:] += np.float32([-0.15, 0.15, 0])  # by a right angle
    in_file = PersonMotion(whole, TIMES, np.concatenate([still, tips], axis=1))
    own = PersonMotion(SKELETON, TIMES, partner)
    line, jolt, turn, _ = joined(
        motion_lines(SKELETON, TIMES, partner, still[None], [own, in_file])
    )
    assert row(line, "turn of a bone in 1/30 s, °") == ["<=", "25", "0", "90.0"]
    jump = 0.15 * np.sqrt(2) * 30**2
    assert row(line, "acceleration of a joint, m/s²") == ["<=", "150", "0", f"{jump:.0f}"]
    assert jolt.startswith(
        f"sample 0: a joint accelerates by {jump:.0f} m/s², right_pinky in frame"
    )
    assert turn.endswith("that to right_pinky in frame 30 (1.00 s), wanted at most 25°")


def test_a_turn_has_less_room_in_a_shorter_step() -> None:
    partner = standing()
    still = partner + np.float32([2, 0, 0])
    wanted_of = {"30": (TIMES, "25"), "120": (TIMES / 4, "6.25"), "15": (2 * TIMES, "50")}
    for fps, (times, wanted) in wanted_of.items():
        people = [PersonMotion(SKELETON, times, motion) for motion in (partner, still)]
        (line,) = joined(motion_lines(SKELETON, times, partner, still[None], people))
        assert row(line, f"turn of a bone in 1/{fps} s, °")[:2] == ["<=", wanted]


def test_where_all_samples_are_beyond_one_limit_one_line_says_so() -> None:
    partner = standing()
    deep = [partner + np.float32([0.02 * n, 0, 0]) for n in range(6)]
    _, line, hint = lines_of(partner, np.stack(deep))
    assert re.match(r"all 6 samples: the bodies are [\d.]+ to [\d.]+ cm deep in each other, ", line)
    bones = r"bones to \w+ and the partner's \w+ in frame 0 \(0.00 s\); "
    worst = "".join(rf"sample \d, {bones}" for _ in range(4))
    assert re.search(rf"wanted at most 8 cm \(the worst first: {worst}\.\.\.\)$", line)
    assert hint.startswith("where all samples are beyond a limit another --seed hardly helps")


def test_many_samples_beyond_a_limit_have_one_line_and_the_others_are_named() -> None:
    partner = standing()
    motions = [partner] * 5 + [partner + np.float32([2, 0, 0])] * 2
    _, line, hint = lines_of(partner, np.stack(motions))
    assert line.startswith("5 of 7 samples: the bodies are ")
    untouched = "in samples 5, 6 no hand touches the other person"
    those = f"within every limit: samples 5, 6; {untouched}"
    assert hint == f"{those}; another --seed gives other samples"


def test_of_three_samples_the_one_between_the_others_is_the_most_like_them() -> None:
    partner = standing()
    motions = [partner + np.float32([metres, 0, 0]) for metres in (3.0, 2.0, 2.4)]
    table, line = lines_of(partner, np.stack(motions))
    # From 3.0: (1.0 + 0.6) / 2 metres.
    assert row(table, "apart from the other samples, cm") == ["80.0", "70.0", "50.0"]
    assert line == "most like the other samples: sample 2"
    assert "apart from" not in lines_of(partner, np.stack(motions[:2]))[0]
    # The next is within the limits; one between all is in the partner.
    inside = np.stack([partner + np.float32([x, 0, 0]) for x in (-2.0, 0.0, 1.9, 2.1)])
    assert "most like the other samples: sample 2" in lines_of(partner, inside)
    alike = lines_of(partner, np.stack(motions[:1] * 3))
    assert not any("most like" in one for one in alike)


@pytest.mark.parametrize(("degrees", "is_said"), [(14, False), (17, True)])
def test_a_partner_who_leans_is_said_to_bow_or_to_be_seen_by_a_tilted_camera(
    degrees: float, is_said: bool
) -> None:
    partner = standing()
    bowing, root = partner.copy(), partner[:, [SKELETON.root]]
    above = [i for i, j in enumerate(SKELETON.joints) if not re.search("hip|knee|ankle|foot", j)]
    own = measure_posture(partner, SKELETON)
    assert own is not None
    leans = float(np.median(angles(own.trunk, np.array([0.0, 1.0, 0.0]))))
    # The trunk leans a little as it is; about the axis of that lean, or nearly.
    about = np.cross([0.0, 1.0, 0.0], np.median(own.trunk, axis=0))
    turn = Rotation.from_rotvec((degrees - leans) * about / np.linalg.norm(about), degrees=True)
    bowing[:, above] = (bowing - root)[:, above] @ turn.as_matrix().T + root
    away = np.float32([2, 0, 0])
    said = [line for line in lines_of(bowing, (partner + away)[None]) if "leans by" in line]
    assert bool(said) == is_said
    assert not any("leans by" in line for line in lines_of(partner, (bowing + away)[None]))


def test_samples_that_are_alike_have_no_worst() -> None:
    partner = standing()
    _, fault, _ = lines_of(partner, np.stack([partner, partner]))
    assert "wanted at most 8 cm (alike: sample 0, bones to spine_mid and " in fault


def with_toe(motion: Motion, toe: np.ndarray) -> PersonMotion:
    """Add an End Site at a place (3,) beyond the left foot."""
    names = (*SKELETON.joints, "left_foot_end")
    foot = SKELETON.joints.index("left_foot")
    whole = Skeleton("whole", names, (*SKELETON.parents, foot), mirror_by_name(names))
    tip = motion[:, [foot]] + toe.astype(np.float32)
    return PersonMotion(whole, TIMES, np.concatenate([motion, tip], axis=1))


def test_a_toe_below_the_floor_is_named_but_for_the_sole_of_the_rig() -> None:
    partner = standing()
    still = partner + np.float32([2, 0, 0])
    lowest = partner[..., 1].min()
    foot = partner[0, SKELETON.joints.index("left_foot"), 1]
    level = with_toe(partner, np.array([0, lowest - foot, 0.1]))
    toes = np.tile([0, lowest - foot, 0.1], (len(TIMES), 1, 1))
    toes[12, 0, 1] -= 0.015
    dips = with_toe(still, toes)
    for sole, wanted in ((0.0, "1 cm"), (0.004, "1.4 cm"), (0.006, "")):
        _, *faults = joined(
            motion_lines(SKELETON, TIMES, partner, still[None], [level, dips], sole)
        )
        if wanted:
            assert faults[0] == (
                "sample 0: the lowest joint or End Site is 1.5 cm below the partner's lowest, "
                f"left_foot_end in frame 12 (0.40 s), wanted at most {wanted}"
            )
        else:
            assert not faults


def test_feet_without_shins_have_no_depth_below_the_floor() -> None:
    joints = ("root", "left_foot", "right_foot", "head")
    skeleton = Skeleton("two feet", joints, (-1, 0, 0, 0), ((1, 2),))
    pose = np.float32([[0, 1, 0], [0.1, 0, 0.05], [-0.1, 0, 0], [0, 1.7, 0.1]])
    partner = np.repeat(pose[None], len(TIMES), axis=0)
    sample = partner + np.float32([2, 0, 0])
    people = [PersonMotion(skeleton, TIMES, motion) for motion in (partner, sample)]
    (line,) = joined(motion_lines(skeleton, TIMES, partner, sample[None], people))
    assert row(line, "slower foot, cm/s")[-1] == "0"
    assert "lowest point" not in line


def test_depth_below_the_partner_is_in_proportion_to_the_legs() -> None:
    partner = standing()
    partner[..., 1] -= np.float32(
        find_floor(partner, find_stance(partner, 30, SKELETON), SKELETON).height
    )
    partner[:, SKELETON.joints.index("left_foot"), 1] = -0.02
    larger = np.float32(1.6) * partner + np.float32([2, 0, 0])
    assert partner[..., 1].min() - larger[..., 1].min() > 0.01
    line, size = lines_of(partner, larger[None])
    assert size.startswith("bodies are 1.60 times as tall as the partner")
    assert row(line, "below the partner's lowest point, cm") == ["<=", "1", "0"]


@pytest.mark.parametrize(("share", "is_named"), [(0.5, False), (0.25, True), (0.0, True)])
def test_a_body_that_stands_still_beside_a_dancer_is_named(share: float, is_named: bool) -> None:
    sway = np.sin(2 * np.pi * TIMES)[:, None, None] * np.float32([0.3, 0, 0])
    still = standing()
    partner = (still + sway).astype(np.float32)
    reaction = (still + share * sway + [2, 0, 0]).astype(np.float32)
    line, *faults = lines_of(partner, reaction[None])
    # A body that does not move at all counts as moving at 3 cm/s.
    speed = 100 * _mean_speed(partner, TIMES)
    assert 60 < speed < 120  # 0.3 m x 4 in a second, less what is smoothed
    ratio = rf"{1 / share:.1f}" if share else f"{speed / 3:.1f}"
    assert row(line, "partner's speed over the reaction's") == ["<=", "3", ratio]
    said = rf"the partner's joints move {ratio} times as fast as those of the reaction, on average"
    assert bool(faults and re.match(rf"sample 0: {said}, wanted at most 3 times", faults[0])) == (
        is_named
    )


@pytest.mark.parametrize(("rise", "is_named"), [(0.05, False), (0.08, True)])
def test_a_body_that_floats_is_named_and_one_that_jumps_is_not(rise: float, is_named: bool) -> None:
    partner = standing()
    floats = partner + np.float32([2, rise, 0])
    jumps = partner + np.float32([2, 0, 0])
    jumps[10:35, :, 1] += np.float32(0.1)
    line, *faults = lines_of(partner, np.stack([floats, jumps]))
    above = "in the median frame that lowest point is {} cm above the partner's, wanted at most 6"
    cells = ["<=", "6", f"{100 * rise:.1f}", "0"]
    assert row(line, "above the partner's lowest point, cm") == cells
    named = f"sample 0: {above.format(f'{100 * rise:.1f}')} cm"
    assert (named in faults) == is_named


def test_crossed_shins_are_named_and_the_partners_crossed_legs_excuse_them() -> None:
    partner = standing()
    crossed = partner + np.float32([2, 0, 0])
    left, right = (SKELETON.joints.index(f"{side}_ankle") for side in ("left", "right"))
    crossed[20, right] = crossed[20, left]
    lines = lines_of(partner, crossed[None])
    scene = Scene((partner, partner), (SKELETON, SKELETON), 30.0)
    (radius,) = {
        float(value)
        for value, bone in zip(capsule_radii(scene), scene.bones[:, 1].tolist(), strict=False)
        if bone == left
    }
    assert lines[1].startswith(
        f"sample 0: the legs of the reaction are {200 * radius:.1f} cm deep in each other, bones "
        "to left_ankle and right_ankle in frame 20 (0.67 s), wanted at most 7 cm"
    )
    crossed[:, right] = crossed[:, left]
    moved = crossed - np.float32([2, 0, 0])
    (line,) = lines_of(moved, crossed[None])
    wanted, own, depth = map(float, row(line, "legs in each other, cm")[1:])
    assert own == depth
    assert depth == pytest.approx(wanted, abs=0.05)
    assert depth > 7
    moved[:, right] += np.float32([0.01, 0, 0])  # less deep: no excuse
    fault = lines_of(moved, crossed[None])[1]
    assert fault.startswith("sample 0: the legs of the reaction are")


def test_a_noisy_partner_and_bodies_of_another_size_are_said() -> None:
    partner = standing()
    giant = np.float32(1.3) * partner + np.float32([2, 0, 0])
    noisy = partner.copy()
    noisy[12:, 1, 2] += 0.4  # 360 m/s²
    assert not any("tall" in line or "noisy" in line for line in lines_of(partner, partner[None]))
    (_, size, *_) = lines_of(partner, np.stack([giant, giant]))
    assert size == "bodies are 1.30 times as tall as the partner (--body partner, --rig)"
    said = [line for line in lines_of(noisy, giant[None]) if "the capture itself" in line]
    joint = "acceleration of a joint 360 m/s²"
    assert len(said) == 1 and f"beyond limits: {joint}, spine_mid in frame 11" in said[0]
    assert "(0.37 s); turn of a bone in 1/30 s 72.0°, that to spine_shoulder in frame 12" in said[0]


def test_a_hand_on_a_trunk_is_on_its_skin_from_either_side() -> None:
    partner = standing()
    sample = partner + np.float32([2, 0, 0])
    hand, trunk = SKELETON.indices(["left_hand", "spine_mid"])
    sample[10:20, hand] = partner[10:20, trunk] + np.float32([0, 0, 0.17])
    partner[30:35, hand] = sample[30:35, trunk] + np.float32([0, 0, 0.17])
    line = lines_of(partner, sample[None])[0]
    assert row(line, "frames of 60: a hand to the partner's body") == ["10"]
    assert row(line, "frames of 60: the partner's hand to the body") == ["5"]


def test_a_partner_with_one_foot_higher_is_on_a_slanted_floor() -> None:
    """As before a tilted camera: the reaction may be half the difference higher."""
    partner = standing()
    (left, right) = feet(SKELETON)
    partner[:, list(left), 1] += np.float32(0.12)
    lowest = {side: float(partner[0, list(side), 1].min()) for side in (left, right)}
    gap = lowest[left] - lowest[right]
    (wanted, limit, *_) = row(
        lines_of(partner, partner[None])[0], "above the partner's lowest point, cm"
    )
    assert wanted == "<="
    assert float(limit) == pytest.approx(6 + 50 * gap, abs=0.06)


@pytest.mark.parametrize("fps", [15, 30, 60, 120])
def test_accelerations_are_alike_at_every_frame_rate(fps: int) -> None:
    times = np.arange(2 * fps) / fps
    motion = np.zeros((len(times), 2, 3), np.float32)
    motion[:, 1, 0] = 0.1 * np.cos(10 * times)  # 10 m/s^2
    found = joint_accelerations(times, motion)
    assert found[:, 0].max() == 0
    assert found.max() == pytest.approx(10, rel=0.06)
    peak = find_peak(found, ("a", "b"), times)
    assert abs(np.cos(10 * times[peak.frame])) == pytest.approx(1, abs=0.05)


def test_who_gives_way_is_measured_from_the_nearest_moment() -> None:
    partner = standing()
    moving = partner + np.float32([0, 0, 1])
    moving[20:40, :, 2] -= np.linspace(0, 0.3, 20, dtype=np.float32)[:, None]
    moving[40:, :, 2] += np.float32(0.1)
    assert row(lines_of(partner, moving[None])[0], "away from the partner after that, cm") == ["40"]


@pytest.mark.parametrize(
    ("beyond", "untouched", "named"),
    [([], [], 1), ([1], [], 2), ([], [1], 2), ([], [0, 2, 3], 2), ([], [1, 2, 3], 1)],
)
def test_the_usual_sample_is_within_limits_and_touches_if_most_do(
    beyond: list[int], untouched: list[int], named: int
) -> None:
    apart = Measurement("apart from the other samples, cm", [4.0, 1.0, 2.0, 3.0])
    limit = Measurement("x", [float(number in beyond) for number in range(4)], limit=0.5)
    said = f"most like the other samples: sample {named}"
    assert _most_alike(apart, [limit], untouched) == [said]


def test_an_embrace_may_be_deeper() -> None:
    """Of two samples as deep, that with hands on the back, both ways, is within the limit."""
    hug = synthesise(11)["hug-1"]
    skeleton, times = hug.skeleton, hug.times
    partner = hug.person_a
    toward = (partner - hug.person_b).mean(axis=(0, 1)) * [1, 0, 1]
    toward = (toward / np.linalg.norm(toward)).astype(np.float32)

    closer = hug.person_b + np.float32(0.11) * toward
    apart = closer.copy()
    hands = [joint for joint, name in enumerate(skeleton.joints) if re.search("hand|wrist", name)]
    apart[:, hands, 1] += 3  # no hand is on the partner's body
    lines = motion_lines(
        skeleton,
        times,
        partner,
        np.stack([closer, apart]),
        [PersonMotion(skeleton, times, motion) for motion in (partner, closer, apart)],
    )
    (table,) = (line for line in lines if line.strip().startswith("bodies in each other"))
    depths = [float(cell) for cell in table.split()[-2:]]
    assert 8 < depths[0] <= 13
    deep = [line for line in lines if "deep in each other" in line and "bodies" in line]
    assert not any(line.startswith("sample 0") for line in deep)
    assert any(line.startswith("sample 1") and "wanted at most 8 cm" in line for line in deep)
