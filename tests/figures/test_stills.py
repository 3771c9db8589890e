"""Trusted: a projection keeps sizes, a fitted picture hides nobody, a strip has every frame."""

from io import BytesIO

import numpy as np
import pytest

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import DUET15, EXPI18, INTERHUMAN22, NTU25, SBU15, Skeleton
from pacmo_core.figures.stills import (
    ASPECT,
    bone_widths,
    choose_camera,
    film_strip,
    fit_view,
    project,
)
from pacmo_core.synthesis import sample_interaction, sample_scripts


@pytest.fixture(scope="module")
def interaction() -> Interaction:
    written = sample_scripts(1, population=1, pairs=1, actions=("handshake",), replications=1)
    return sample_interaction(*next(iter(written)))


def test_a_projection_keeps_distances_and_handedness(interaction: Interaction) -> None:
    camera = choose_camera(interaction)
    axes = project(np.eye(3) + camera.centre, camera)
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_a_higher_point_is_seen_higher_and_a_nearer_one_lower(interaction: Interaction) -> None:
    camera = choose_camera(interaction)
    nearer = np.cross(camera.right, [0.0, 1.0, 0.0])
    floor, high, near = project(
        np.array(
            [camera.centre, camera.centre + np.array([0.0, 1.0, 0.0]), camera.centre + nearer]
        ),
        camera,
    )
    assert high[1] > floor[1] > near[1]
    assert near[2] > floor[2]


def test_people_stand_side_by_side(interaction: Interaction) -> None:
    camera = choose_camera(interaction)
    a, b = (
        project(motion[:, 0].astype(np.float64), camera).mean(axis=0)
        for motion in (interaction.person_a, interaction.person_b)
    )
    assert b[0] - a[0] > 0.8 * np.linalg.norm(b - a)


def test_a_fitted_picture_shows_both_people_whole(interaction: Interaction) -> None:
    camera, frames = choose_camera(interaction), [0, 20, 40]
    box = fit_view(interaction, frames, camera, 0.5)
    both = np.concatenate([interaction.person_a, interaction.person_b], axis=1)[frames]
    x, y, _ = project(both.astype(np.float64), camera).reshape(-1, 3).T
    assert box.left < x.min() < x.max() < box.left + box.width
    assert box.bottom < y.min() < y.max() < box.bottom + ASPECT * box.width
    assert fit_view(interaction, frames, camera, 9.0).width == 9.0


@pytest.mark.parametrize("skeleton", [NTU25, SBU15, DUET15, EXPI18, INTERHUMAN22])
def test_every_published_skeleton_has_a_width_for_every_bone(skeleton: Skeleton) -> None:
    widths = bone_widths(skeleton)
    assert all(0.02 < width < 0.3 for width in widths)


def test_a_strip_has_a_picture_a_frame_and_the_same_bytes_twice(interaction: Interaction) -> None:
    drawn = []
    for _ in range(2):
        figure = film_strip([("shake", interaction, [0, 30])] * 2, min_width=2.0, inches=1.0)
        assert len(figure.axes) == 4
        page = BytesIO()
        figure.savefig(page, format="png", dpi=40, metadata={"Software": None})
        drawn.append(page.getvalue())
    assert drawn[0] == drawn[1]
