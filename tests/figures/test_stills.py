"""Trusted: a projection keeps sizes, a fitted picture hides nobody, a strip has every frame."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle
from PIL import Image

from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from pacmo_core.figures.stills import (
    ASPECT,
    COLOURS,
    bone_widths,
    choose_camera,
    film_strip,
    fit_view,
    project,
    write_strip,
)
from pacmo_core.figures.viewer import Scene
from pacmo_core.synthesis import sample_interaction, sample_scripts


@pytest.fixture(scope="module")
def scene() -> Scene:
    written = sample_scripts(1, population=1, pairs=1, actions=("handshake",), replications=1)
    return Scene.of("shake", sample_interaction(*next(iter(written))))


def test_a_projection_keeps_distances_and_handedness(scene: Scene) -> None:
    camera = choose_camera(scene)
    axes = project(np.eye(3) + camera.centre, camera)
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_a_higher_point_is_seen_higher_and_a_nearer_one_lower(scene: Scene) -> None:
    camera = choose_camera(scene)
    nearer = np.cross(camera.right, [0.0, 1.0, 0.0])
    floor, high, near = project(
        np.array(
            [camera.centre, camera.centre + np.array([0.0, 1.0, 0.0]), camera.centre + nearer]
        ),
        camera,
    )
    assert high[1] > floor[1] > near[1]
    assert near[2] > floor[2]


def test_people_stand_side_by_side(scene: Scene) -> None:
    camera = choose_camera(scene)
    a, b = (
        project(motion[:, 0].astype(np.float64), camera).mean(axis=0) for motion in scene.people
    )
    assert b[0] - a[0] > 0.8 * np.linalg.norm(b - a)


def test_a_fitted_picture_shows_both_people_whole(scene: Scene) -> None:
    camera, frames = choose_camera(scene), [0, 20, 40]
    box = fit_view(scene, frames, camera, 0.5)
    x, y, _ = project(scene.positions[frames], camera).reshape(-1, 3).T
    assert box.left < x.min() < x.max() < box.left + box.width
    assert box.bottom < y.min() < y.max() < box.bottom + ASPECT * box.width
    assert fit_view(scene, frames, camera, 9.0).width == 9.0


@pytest.mark.parametrize("skeleton", [NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22])
def test_every_published_skeleton_has_a_width_for_every_bone(skeleton: Skeleton) -> None:
    widths = bone_widths(skeleton)
    assert all(0.02 < width < 0.3 for width in widths)


def test_a_strip_has_a_picture_a_frame_and_the_same_bytes_twice(scene: Scene) -> None:
    drawn = []
    for _ in range(2):
        figure = film_strip([(scene, [0, 30])] * 2, min_width=2.0, inches=1.0)
        assert len(figure.axes) == 4
        page = BytesIO()
        figure.savefig(page, format="png", dpi=40, metadata={"Software": None})
        drawn.append(page.getvalue())
    assert drawn[0] == drawn[1]


def test_all_rows_of_a_clip_have_one_scale(scene: Scene) -> None:
    wide = replace(scene, people=(scene.people[0], scene.people[1] + np.float32([2, 0, 0])))
    axes = film_strip([(scene, [0]), (wide, [0])], min_width=1.0, inches=1.0, follow=True).axes
    assert len({round(float(np.ptp(one.get_xlim())), 6) for one in axes}) == 1


def pixels(scene: Scene) -> np.ndarray:
    page = BytesIO()
    film_strip([(scene, [0, 30])], min_width=2.0, inches=3.0).savefig(page, format="png", dpi=60)
    with Image.open(page) as found:
        return np.asarray(found.convert("RGB")).astype(int)


def test_people_of_two_skeletons_are_drawn_as_people_of_one(scene: Scene) -> None:
    # Person b's joints in another order and under another name: the body is the same.
    order = np.random.default_rng(1).permutation(len(NTU25.joints))
    place = {old: new for new, old in enumerate(order.tolist())}
    place[-1] = -1
    other = Skeleton(
        "other",
        tuple(NTU25.joints[joint] for joint in order),
        tuple(place[NTU25.parents[joint]] for joint in order),
    )
    a, b = scene.people
    two = replace(scene, people=(a, b[:, order]), other=other)
    far = np.abs(pixels(two) - pixels(scene)).max(axis=-1)
    assert (far > 30).mean() < 1e-3


def test_a_person_alone_is_drawn_once_in_the_colour_of_the_first(scene: Scene) -> None:
    alone = pixels(replace(scene, people=scene.people[:1]))
    assert (alone[..., 2] - alone[..., 0] > 60).any()
    assert not (alone[..., 0] - alone[..., 2] > 60).any()


def test_a_head_is_drawn_where_the_joints_say_or_else_at_the_end_of_the_neck(scene: Scene) -> None:
    # As CMU's trials 18 and 19 come: no joint has the name of a head.
    words = {"neck": "lowerneck", "head": "upperneck"}
    body = replace(NTU25, joints=tuple(words.get(joint, joint) for joint in NTU25.joints))
    for skeleton in (NTU25, body):
        shown = replace(scene, skeleton=skeleton)
        (axes,) = film_strip([(shown, [7])], min_width=2.0, inches=1.0).axes
        discs = [patch for patch in axes.patches if isinstance(patch, Circle)]
        heads = [motion[7, NTU25.joints.index("head")] for motion in scene.people]
        wanted = project(np.array(heads, float), choose_camera(scene))[:, :2]
        np.testing.assert_allclose([disc.center for disc in discs], wanted, atol=1e-9)


def test_a_thing_that_is_held_is_a_disc_and_no_limb(scene: Scene) -> None:
    body = scene.skeleton
    joints, parents = (*body.joints, "object"), (*body.parents, body.root)
    held = Skeleton("held", joints, parents, body.left_right)
    people = tuple(
        np.concatenate([motion, motion[:, [body.root]] + np.float32(place)], axis=1)
        for motion, place in zip(scene.people, (0.4, 0.0), strict=True)
    )
    with_object = replace(scene, skeleton=held, people=people)
    before, after = (
        film_strip([(one, [5])], min_width=1.9, inches=2.0).axes[0] for one in (scene, with_object)
    )
    assert len(after.lines) == len(before.lines)
    assert [sum(isinstance(p, Circle) for p in axes.patches) for axes in (before, after)] == [2, 4]


def test_people_are_large_enough_to_be_judged(scene: Scene, tmp_path: Path) -> None:
    write_strip(tmp_path / "x.png", scene)
    with Image.open(tmp_path / "x.png") as found:
        height, width = found.height // 4, found.width // 4
        picture = np.asarray(found.convert("RGB"), float)[:height, :width] / 255
    for colour in COLOURS:
        tone = np.array(to_rgb(colour))
        shares = picture / np.maximum(picture.max(axis=-1, keepdims=True), 0.1)
        is_person = np.abs(shares - tone / tone.max()).max(axis=-1) < 0.1
        assert np.ptp(np.nonzero(is_person.any(axis=1))[0]) > 200, "pixels from head to foot"
