"""Trusted: what naive scaling does to a trunk, and the names of its joints."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.skeleton import INTERHUMAN22, NTU25
from pacmo_core.interaction_mesh import prepare, retarget
from pacmo_core.interaction_mesh.energy import (
    build_energy,
    energy_target,
    energy_terms,
)
from pacmo_core.interaction_mesh.mesh import ancestor_bones, trunk_joints
from pacmo_core.interaction_mesh.scene import naive_scaling
from tests.interaction_mesh.scenes import SETTINGS, scene
from tests.interaction_mesh.test_report import person


@pytest.mark.parametrize("skeleton", [NTU25, INTERHUMAN22])
def test_a_trunk_reaches_from_the_root_to_hips_and_shoulders_and_holds_no_limb(skeleton):
    a, b = trunk_joints(person(skeleton))
    np.testing.assert_array_equal(b, a + len(skeleton.joints))
    names = {skeleton.joints[i] for i in a}
    assert skeleton.joints[skeleton.root] in names
    assert {"left_hip", "right_hip", "left_shoulder", "right_shoulder"} <= names
    assert not any(part in name for name in names for part in ("elbow", "knee", "wrist", "head"))


def test_a_bone_lies_on_the_path_of_what_hangs_on_it():
    source = scene()
    found = ancestor_bones(source) @ source.bone_vectors.transpose(1, 0, 2).reshape(10, -1)
    roots = np.repeat(source.points[:, [0, 6]], 6, axis=1)
    expected = (source.points - roots).transpose(1, 0, 2).reshape(12, -1)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_trunk_scaled_where_it_points_and_moved_costs_nothing_and_one_bent_does():
    source = scene(1)
    scales = np.random.default_rng(0).uniform(0.8, 1.2, size=(1, 10))
    energy = build_energy(source, SETTINGS)
    change = naive_scaling(source, scales) - source.points[..., None] + 0.3
    target = energy_target(energy, scales)
    assert energy_terms(energy, change, target)["trunk_shape"][0] == pytest.approx(0, abs=1e-20)
    change[:, 1] += 0.1  # the chest against the root
    expected = SETTINGS.weights.trunk_shape * len(source.points) * 2 * 0.05**2 * 3 / 2
    assert energy_terms(energy, change, target)["trunk_shape"][0] == pytest.approx(expected)


def test_a_smaller_body_folds_its_trunk_less_the_more_that_weighs():
    source = scene(2)
    scales = np.ones((1, 10))
    scales[0, :5] = 0.75

    def bent(weight: float) -> float:
        weights = replace(SETTINGS.weights, trunk_shape=weight)
        points = retarget(prepare(source, replace(SETTINGS, weights=weights)), scales).points[0]
        trunk = points[:, 1] - points[:, 0]
        wanted = 0.75 * source.bone_vectors[:, 0]
        return float(np.linalg.norm(trunk - wanted, axis=-1).mean())

    assert bent(100) < 0.2 * bent(0)
