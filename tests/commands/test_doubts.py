"""Captures that are used with a doubt. Truth: bodies that are moved by hand."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from pacmo_core.commands.cli import app
from pacmo_core.commands.doubts import doubts, lost_bones
from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.formats.registry import PersonMotion, read_partner
from pacmo_core.formats.write_bvh import format_bvh
from tests.formats.real_files import real_folder
from tests.formats.rigged import mixamo, people

CLIP = people().frames(0, 12)
BODY, (MOTION, _) = mixamo(CLIP, prefix="")
BEYOND_CHEST = ["Neck", "LeftShoulder", "RightShoulder"]


def at_parent(names: list[str], body: Skeleton = BODY, motion: Motion = MOTION) -> Motion:
    """Move joints to the places of their parents."""
    moved = motion.copy()
    for joint in body.indices(names):
        moved[:, joint] = moved[:, body.parents[joint]]
    return moved


def with_joints(*joints: tuple[str, str]) -> tuple[Skeleton, Motion]:
    """Add joints at the places of their parents."""
    names = (*BODY.joints, *(name for name, _ in joints))
    parents = (*BODY.parents, *(BODY.joints.index(parent) for _, parent in joints))
    rows = [*range(len(BODY.joints)), *parents[len(BODY.joints) :]]
    return Skeleton("more", names, parents, mirror_by_name(names)), MOTION[:, rows]


def view(tmp_path: Path, *words: object) -> Result:
    out = ["--out", str(tmp_path / "o.html"), "--no-open"]
    said = CliRunner().invoke(app, ["view", *map(str, words), *out])
    assert said.exit_code == 0, said.output
    return said


def test_the_bone_is_lost_whose_children_are_all_where_it_begins() -> None:
    assert lost_bones(BODY, MOTION) == {}
    assert lost_bones(BODY, at_parent(BEYOND_CHEST)) == {"Spine2": BEYOND_CHEST}
    touching = at_parent(BEYOND_CHEST)
    touching[5, BODY.joints.index("Neck")] += np.float32(0.01)
    assert lost_bones(BODY, touching) == {}


def test_helpers_and_hips_in_one_place_are_no_lost_bones() -> None:
    assert lost_bones(BODY, at_parent(["LeftShoulder"])) == {}
    assert lost_bones(BODY, at_parent(["LeftForeArm"])) == {}
    assert lost_bones(BODY, at_parent(["LeftUpLeg", "RightUpLeg", "Spine"])) == {}
    of_hand = [(f"LeftHand{name}", "LeftHandMiddle1") for name in ("Nail", "Ring")]
    assert lost_bones(*with_joints(*of_hand)) == {}
    below = Skeleton("below", ("Reference", *BODY.joints), (-1, *(p + 1 for p in BODY.parents)))
    motion = at_parent(["LeftUpLeg", "RightUpLeg", "Spine"])
    floor = np.zeros_like(motion[:, :1])
    assert lost_bones(below, np.concatenate([floor, motion], axis=1)) == {}


def test_lost_bones_are_said_once_with_what_they_make_short(tmp_path: Path) -> None:
    file = tmp_path / "x.bvh"
    file.write_text(format_bvh(at_parent(BEYOND_CHEST), 30, BODY))
    assert view(tmp_path, file, "--from-unit", "m", "--from-up", "y").stderr == (
        f"{file}: bones of length zero, as a conversion loses them: Neck, LeftShoulder and "
        "RightShoulder are at Spine2: trunk too short, and touches may be missed; wanted another "
        "conversion\n"
    )


def test_of_real_captures_only_that_which_lost_bones_is_doubted() -> None:
    folder = real_folder("cmu_raw")
    found = {}
    for name in ("18_01", "cmu_60_01"):
        settings = {"unit": 0.0254 / 0.45, "up": "y"}
        person = read_partner(folder / f"{name}.bvh", "bvh", settings, person=None, clip="")
        found[name] = lost_bones(person.skeleton, person.motion)
    chest = ["lowerneck", "lclavicle", "rclavicle"]
    hands = {f"{side}wrist": [f"{side}hand", f"{side}thumb"] for side in "lr"}
    assert found == {"18_01": {"thorax": chest, **hands}, "cmu_60_01": {}}


@pytest.mark.parametrize(("height", "is_said"), [(0.2, True), (-0.2, True), (0.05, False)])
def test_two_floors_are_said_once(tmp_path: Path, height: float, is_said: bool) -> None:
    file = tmp_path / "x.npz"
    other = MOTION + np.float32([1, height, 0])
    facts = {"joints": BODY.joints, "parents": BODY.parents, "fps": 30, "unit": 1.0, "up": "y"}
    np.savez(file, person_a=MOTION, person_b=other, **facts)
    said = view(tmp_path, file).stderr
    low, high = ("a", "b") if height > 0 else ("b", "a")
    text = f"{file}: the lowest point of person {low} is 20 cm"
    assert said.startswith(text) == is_said
    assert said.count("\n") == is_said
    assert (f" cm below that of {high} in the median frame" in said) == is_said


def test_a_person_who_is_lifted_for_a_while_is_on_the_same_floor(tmp_path: Path) -> None:
    file = tmp_path / "x.npz"
    lifted = MOTION + np.float32([1, 0, 0])
    lifted[3:] += np.float32([0, 0.6, 0])
    facts = {"joints": BODY.joints, "parents": BODY.parents, "fps": 30, "unit": 1.0, "up": "y"}
    np.savez(file, person_a=MOTION, person_b=lifted, **facts)
    assert view(tmp_path, file).stderr == ""


@pytest.mark.parametrize(
    ("side", "raised", "is_named"), [("Left", 0.4, True), ("Right", 0.1, False)]
)
def test_a_leg_in_the_air_throughout_is_named(side: str, raised: float, is_named: bool) -> None:
    motion = MOTION.copy()
    foot = [number for number, name in enumerate(BODY.joints) if name.startswith(f"{side}Foot")]
    foot += [number for number, name in enumerate(BODY.joints) if name.startswith(f"{side}Toe")]
    motion[:, foot, 1] += np.float32(raised)
    person = PersonMotion(BODY, CLIP.times, motion)
    lines = doubts([Path("x.bvh")], [person])
    found = [line for line in lines if "above the other throughout" in line]
    assert len(found) == is_named
    if found:
        assert found[0].startswith(f"x.bvh: {side}Foot is over 3")


def test_a_mirrored_capture_is_doubted() -> None:
    for sign in (1, -1):
        person = PersonMotion(BODY, CLIP.times, MOTION * np.float32([sign, 1, 1]))
        lines = doubts([Path("a.bvh")], [person])
        assert [line.startswith("a.bvh: toes point backwards") for line in lines] == [True] * (
            sign < 0
        )
    on_the_back = MOTION[..., [0, 2, 1]] * np.float32([1, 1, -1])  # turned about x
    for sign in (1, -1):  # of who lies the toes do not tell
        lying = PersonMotion(BODY, CLIP.times, on_the_back * np.float32([sign, 1, 1]))
        assert not any("toes" in line for line in doubts([Path("a.bvh")], [lying]))


@pytest.mark.parametrize("frames", [0, 3, 6])
def test_frames_without_tracking_are_doubted(frames: int) -> None:
    nowhere, frozen = MOTION.copy(), MOTION.copy()
    nowhere[4 : 4 + frames] = 0
    frozen[5 : 5 + frames] = frozen[4]
    said = [doubts([Path("a")], [PersonMotion(BODY, CLIP.times, m)]) for m in (nowhere, frozen)]
    place, still = (" ".join(lines) for lines in said)
    in_frames = f"in {frames} frames, the first of them"
    assert (f"in one place {in_frames} 4 (0.13 s)" in place) == bool(frames)
    assert (f"does not move at all {in_frames} 5 (0.17 s)" in still) == (frames > 4)
    assert frames or said == [[], []]


def test_people_who_lie_throughout_are_doubted_unless_one_stands() -> None:
    standing = PersonMotion(BODY, CLIP.times, MOTION)
    lying = PersonMotion(BODY, CLIP.times, MOTION[..., [0, 2, 1]])
    files = [Path("a.bvh"), Path("b.bvh")]

    def said(*people: PersonMotion) -> list[str]:
        lines = doubts(files[: len(people)], people)
        return [line.partition(":")[0] for line in lines if "the trunk of a person" in line]

    assert said(lying) == ["a.bvh"]
    assert said(lying, lying) == ["a.bvh", "b.bvh"]
    assert said(lying, standing) == said(standing) == []
