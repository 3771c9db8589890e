"""Truth: the Khronos validator; three.js's loaders; forward kinematics; the standard's layout."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from pacmo_core.figures.body_mesh import make_skin
from pacmo_core.figures.body_shape import make_body_shape
from pacmo_core.formats.fit_bones import fit_bones
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.formats.write_gltf import (
    AnimatedPerson,
    gltf_document,
    quaternions,
    rest_positions,
    to_glb,
    to_gltf,
)
from tests.formats.moving import moving
from tests.node import node_json

BODIES = [NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22]
FPS = 30.0
FRAMES = [0, 3, 7]


def actor(name: str, motion: np.ndarray, skeleton: Skeleton) -> AnimatedPerson:
    fitted = fit_bones(motion, skeleton)
    skin = make_skin(make_body_shape(skeleton), skeleton, rest_positions(fitted, skeleton))
    return AnimatedPerson(name, skeleton, fitted, skin, (0.1, 0.2, 0.9))


def written(file: Path, skeleton: Skeleton, motions: list[np.ndarray]) -> list[AnimatedPerson]:
    actors = [actor("ab"[k], motion, skeleton) for k, motion in enumerate(motions)]
    document, data = gltf_document(np.arange(len(motions[0])) / FPS, actors)
    file.write_bytes((to_glb if file.suffix == ".glb" else to_gltf)(document, data))
    return actors


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".glb", ".gltf"])
@pytest.mark.parametrize("skeleton", BODIES, ids=lambda s: s.name)
def test_the_khronos_validator_has_nothing_to_say(
    tmp_path: Path, skeleton: Skeleton, ending: str
) -> None:
    motions = [moving(skeleton, 1), moving(skeleton, 2)]
    written(tmp_path / f"clip{ending}", skeleton, motions)
    report = node_json("validate.mjs", tmp_path / f"clip{ending}")
    assert report["issues"]["messages"] == []
    assert report["info"]["animationCount"] == 1
    assert report["info"]["hasSkins"] is True


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_three_js_puts_the_joints_of_both_people_where_they_were(
    tmp_path: Path, ending: str
) -> None:
    motions = [moving(NTU25, 3), moving(NTU25, 4)]
    written(tmp_path / f"clip{ending}", NTU25, motions)
    times = [frame / FPS for frame in FRAMES]
    seen = node_json("load.mjs", tmp_path / f"clip{ending}", *times)
    assert seen["duration"] == pytest.approx(7 / FPS, abs=1e-5)
    for k, motion in enumerate(motions):
        order = [seen["joints"].index(f"{'ab'[k]}_{joint}") for joint in NTU25.joints]
        far = np.linalg.norm(np.array(seen["places"])[:, order] - motion[FRAMES], axis=-1)
        assert far.mean() <= 1e-3
        assert far.max() <= 5e-3


@pytest.mark.slow
def test_three_js_puts_the_joints_of_a_bvh_where_they_were(tmp_path: Path) -> None:
    motion = moving(NTU25, 5)
    (tmp_path / "clip.bvh").write_text(format_bvh(motion, FPS, NTU25))
    times = [frame / FPS for frame in FRAMES]
    seen = node_json("load.mjs", tmp_path / "clip.bvh", *times)
    order = [seen["joints"].index(joint) for joint in NTU25.joints]
    far = np.linalg.norm(np.array(seen["places"])[:, order] - motion[FRAMES], axis=-1)
    assert far.mean() <= 1e-3
    assert far.max() <= 5e-3


@pytest.mark.slow
def test_three_js_moves_the_skin_along_with_the_bones(tmp_path: Path) -> None:
    # An arm of two bones: its ends are balls about its joints, in whatever way it turns.
    arm = Skeleton("arm", ("shoulder", "elbow", "hand"), (-1, 0, 1))
    motion = moving(arm, 6)
    (found,) = written(tmp_path / "arm.glb", arm, [motion])
    seen = node_json("load.mjs", tmp_path / "arm.glb", *[frame / FPS for frame in FRAMES])
    (_, _, shoulder, elbow), (_, _, _, hand) = make_body_shape(arm).limbs
    for frame, skin in zip(FRAMES, np.array(seen["skins"]), strict=True):
        away = np.linalg.norm(skin[:, None] - motion[frame].astype(np.float64)[None], axis=-1)
        radius = np.array([shoulder, elbow, hand])[away.argmin(axis=1)]
        np.testing.assert_allclose(away.min(axis=1), radius, atol=1e-3)
    assert len(found.skin.positions) == len(seen["skins"][0])


@pytest.mark.parametrize("skeleton", BODIES, ids=lambda s: s.name)
def test_faces_look_outward_and_every_vertex_has_a_joint(skeleton: Skeleton) -> None:
    skin = actor("a", moving(skeleton, 7), skeleton).skin
    corners = skin.positions[skin.faces].astype(np.float64)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = skin.normals[skin.faces].mean(axis=1)
    area = np.linalg.norm(outward, axis=1)
    assert ((outward * normal).sum(axis=1)[area > 1e-7] > 0).mean() > 0.97
    np.testing.assert_allclose(np.linalg.norm(skin.normals, axis=1), 1, atol=1e-5)
    assert set(skin.joints.tolist()) <= set(range(len(skeleton.joints)))


def test_a_binary_file_is_laid_out_as_the_standard_says(tmp_path: Path) -> None:
    written(tmp_path / "clip.glb", SBU15, [moving(SBU15, 8)])
    content = (tmp_path / "clip.glb").read_bytes()
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    size, kind = struct.unpack_from("<I4s", content, 12)
    assert kind == b"JSON"
    document = json.loads(content[20 : 20 + size])
    binary, kind = struct.unpack_from("<I4s", content, 20 + size)
    assert kind == b"BIN\0"
    assert size % 4 == binary % 4 == 0
    assert 0 <= binary - document["buffers"][0]["byteLength"] < 4


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.integers(0, 10_000))
def test_quaternions_are_the_rotations_without_jumps(seed: int) -> None:
    random = np.random.default_rng(seed)
    axis, turns = random.normal(size=3), np.linspace(0, 4 * np.pi, 80)
    wanted = Rotation.from_rotvec(turns[:, None] * axis / np.linalg.norm(axis)).as_matrix()
    found = quaternions(wanted)
    np.testing.assert_allclose(Rotation.from_quat(found).as_matrix(), wanted, atol=1e-5)
    assert (np.linalg.norm(np.diff(found, axis=0), axis=1) < 0.2).all()
