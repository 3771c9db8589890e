"""Truth: the motion that went in, read back from the page's own bytes by NumPy."""

import base64

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacmo_core.figures.body import body_of
from pacmo_core.figures.clips import Panel, PlayedClip, pack, packed_clip
from pacmo_core.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
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


@settings(derandomize=True, deadline=None, max_examples=50)
@given(
    st.integers(0, 2**32 - 1),
    st.tuples(*[st.floats(-1000, 1000)] * 3),
)
def test_a_packed_motion_reads_back_within_half_a_millimetre(
    random_seed: int, origin: tuple[float, float, float]
) -> None:
    rng = np.random.default_rng(random_seed)
    motion = (rng.uniform(-30, 30, (5, 15, 3)) + origin).astype(np.float32)
    read = np.frombuffer(base64.b64decode(pack(motion, np.array(origin))), "<i2")
    back = read.reshape(motion.shape) / 1000 + np.array(origin)
    assert np.abs(back - motion).max() <= 0.0005 + 1e-9


def test_a_motion_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"32\.767 m of its origin; got 40\.0 m"):
        pack(np.full((2, 3, 3), 40, np.float32), np.zeros(3))


def test_a_clip_far_from_the_worlds_origin_packs_round_its_own() -> None:
    shown = interaction(1)
    far = PlayedClip("n", "", (Panel("real", shown),))
    packed = packed_clip(far)
    partner = np.frombuffer(base64.b64decode(packed["panels"][0]["partner"]), "<i2")
    back = partner.reshape(shown.person_a.shape) / 1000 + np.array(packed["origin"])
    assert np.abs(back - shown.person_a).max() <= 0.0005 + 1e-9


def test_times_read_back_within_a_twentieth_of_a_millisecond() -> None:
    shown = interaction(1, fps=29.97)
    packed = packed_clip(PlayedClip("n", "", (Panel("real", shown),)))
    ticks = np.frombuffer(base64.b64decode(packed["panels"][0]["ticks"]), "<i4")
    assert np.abs(ticks / 10_000 - shown.times).max() <= 0.00005 + 1e-12


def test_the_camera_looks_across_the_line_between_the_people() -> None:
    shown = interaction(1)
    yaw = packed_clip(PlayedClip("n", "", (Panel("real", shown),)))["view"]["yaw"]
    right = np.array([np.cos(yaw), 0, -np.sin(yaw)])
    apart = (shown.person_b - shown.person_a).mean(axis=(0, 1)) * [1, 0, 1]
    assert right @ apart == pytest.approx(np.linalg.norm(apart), rel=1e-6)


@pytest.mark.parametrize("skeleton", BODIES, ids=lambda s: s.name)
def test_a_published_body_has_a_head_a_trunk_and_every_limb(skeleton: Skeleton) -> None:
    shown = interaction(1, skeleton)
    body = packed_clip(PlayedClip("n", "", (Panel("real", shown),)))["panels"][0]["body"]
    assert body["head"]
    assert len(body["trunk"]) == 4
    ends = {skeleton.joints[child] for _, child, _, _ in body["limbs"]}
    limbs = {j for j in skeleton.joints if any(w in j for w in ("elbow", "wrist", "knee", "ankle"))}
    assert limbs <= ends | {skeleton.joints[p] for p, _, _, _ in body["limbs"]}


def test_a_captured_body_has_its_head_on_its_neck_and_its_trunk_between_arms_and_legs() -> None:
    body = body_of(MOCAP)
    assert [MOCAP.joints[j] for j in body.head] == ["Head", "HeadEnd"]
    corners = ["LeftArm", "RightArm", "LeftUpLeg", "RightUpLeg"]
    assert [MOCAP.joints[j] for j, _ in body.trunk] == corners
    radius = {MOCAP.joints[child]: (rp, rc) for _, child, rp, rc in body.limbs}
    assert radius["LeftLeg"][0] > radius["LeftLeg"][1] > radius["LeftFoot"][1]
    assert radius["LeftLeg"] == radius["RightLeg"]


def test_a_body_with_unknown_names_is_all_capsules() -> None:
    chain = Skeleton("chain", ("p", "q", "s"), (-1, 0, 1))
    shown = interaction(1, chain)
    body = packed_clip(PlayedClip("n", "", (Panel("real", shown),)))["panels"][0]["body"]
    assert not body["trunk"]
    assert [limb[:2] for limb in body["limbs"]] == [(0, 1), (1, 2)]
