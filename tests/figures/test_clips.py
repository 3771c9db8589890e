"""Truth: what the sets publish of their bodies: which joints are heads, trunks and limbs."""

import pytest

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from pacmo_core.figures.body_shape import make_body_shape
from pacmo_core.figures.viewer import Scene, packed_scenes
from tests.figures.samples import interaction

_SIDES = ("Left", "Right")
MOCAP = Skeleton(
    "mocap",
    (
        *("Hips", "Spine", "Neck", "Head", "HeadEnd"),
        *(side + part for side in _SIDES for part in ("Shoulder", "Arm", "ForeArm", "Hand")),
        *(side + part for side in _SIDES for part in ("UpLeg", "Leg", "Foot", "ToeBase")),
    ),
    (-1, 0, 1, 2, 3, 1, 5, 6, 7, 1, 9, 10, 11, 0, 13, 14, 15, 0, 17, 18, 19),
    ((5, 9), (6, 10), (7, 11), (8, 12), (13, 17), (14, 18), (15, 19), (16, 20)),
)
BODIES = [NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22]


def packed_body(skeleton: Skeleton) -> dict:
    (facts,) = packed_scenes([Scene.of("n", interaction(1, skeleton))], contact=0.1)
    return dict(facts["body"])


@pytest.mark.parametrize("skeleton", BODIES, ids=lambda s: s.name)
def test_a_published_body_has_a_head_a_trunk_and_every_limb(skeleton: Skeleton) -> None:
    body = packed_body(skeleton)
    assert body["head"]
    assert len(body["trunk"]) == 4
    ends = {skeleton.joints[child] for _, child, _, _ in body["limbs"]}
    limbs = {j for j in skeleton.joints if any(w in j for w in ("elbow", "wrist", "knee", "ankle"))}
    assert limbs <= ends | {skeleton.joints[p] for p, _, _, _ in body["limbs"]}


def test_a_captured_body_has_its_head_on_its_neck_and_its_trunk_between_arms_and_legs() -> None:
    body = make_body_shape(MOCAP)
    assert [MOCAP.joints[j] for j in body.head] == ["Head", "HeadEnd"]
    corners = ["LeftArm", "RightArm", "LeftUpLeg", "RightUpLeg"]
    assert [MOCAP.joints[j] for j, _ in body.trunk] == corners
    radius = {MOCAP.joints[child]: (rp, rc) for _, child, rp, rc in body.limbs}
    assert radius["LeftLeg"][0] > radius["LeftLeg"][1] > radius["LeftFoot"][1]
    assert radius["LeftLeg"] == radius["RightLeg"]


def test_a_head_without_a_name_is_the_end_of_the_neck_and_on_it() -> None:
    joints = (
        "root chest lowerneck upperneck lshoulder lelbow rshoulder relbow lhip lknee rhip rknee"
    )
    body = Skeleton(
        "cmu",
        tuple(joints.split()),
        (-1, 0, 1, 2, 1, 4, 1, 6, 0, 8, 0, 10),
        ((4, 6), (5, 7), (8, 10), (9, 11)),
    )  # fmt: skip
    shape = make_body_shape(body)
    assert (shape.head, shape.head_radius) == ((3,), make_body_shape(MOCAP).head_radius)
    assert len(shape.trunk) == 4
    assert (2, 3) in [limb[:2] for limb in shape.limbs]


def test_a_thing_that_is_held_is_a_ball_and_no_limb() -> None:
    with_object = Skeleton(
        "held", (*MOCAP.joints, "object"), (*MOCAP.parents, MOCAP.root), MOCAP.left_right
    )
    thing = len(MOCAP.joints)
    body, held = make_body_shape(MOCAP), make_body_shape(with_object)
    assert held.limbs[:-1] == body.limbs and held.limbs[-1][:2] == (thing, thing)
    assert (held.head, held.trunk) == (body.head, body.trunk)
    assert with_object.body_bones.tolist() == MOCAP.bones.tolist()
    assert len(with_object.bones) == len(MOCAP.bones) + 1


def test_a_body_with_unknown_names_is_all_capsules() -> None:
    chain = Skeleton("chain", ("p", "q", "s"), (-1, 0, 1))
    body = packed_body(chain)
    assert not body["trunk"]
    assert [limb[:2] for limb in body["limbs"]] == [(0, 1), (1, 2)]
