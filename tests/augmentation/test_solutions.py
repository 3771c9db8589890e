"""Truth: the closed forms of the factors; who has the smaller weight is moved more."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.augmentation.plan import plan_variations
from pacmo_core.augmentation.run import body_key
from pacmo_core.augmentation.solutions import Solution, SolutionSettings, draw_solutions
from pacmo_core.interaction_mesh import prepare, retarget
from tests.augmentation.test_plan import BODIES, PAPER
from tests.interaction_mesh.scenes import SETTINGS, random_scales, touching_scene

DRAWN = SolutionSettings(n=400, yielding=1.5, root=1.0, limbs=0.7, random_seed=2)


def test_the_first_solution_has_the_solvers_own_weights() -> None:
    first = draw_solutions(DRAWN, "CLIP")[0]
    assert first == Solution()
    assert first.apply(SETTINGS) == SETTINGS


def test_factors_are_log_normal_and_other_for_another_source() -> None:
    drawn = draw_solutions(DRAWN, "CLIP")
    logs = np.log([[s.yielding, s.root, s.limbs] for s in drawn[1:]])
    assert abs(logs.mean(axis=0)) == pytest.approx(0, abs=0.2)
    assert logs.std(axis=0) == pytest.approx([1.5, 1.0, 0.7], rel=0.1)
    assert drawn == draw_solutions(DRAWN, "CLIP")
    assert drawn[:3] == draw_solutions(replace(DRAWN, n=3), "CLIP")
    assert drawn[1] != draw_solutions(DRAWN, "OTHER")[1]


def test_the_inverse_factors_give_the_settings_back() -> None:
    there = Solution(1, yielding=2.0, root=8.0, limbs=4.0).apply(SETTINGS)
    assert there.weights.posture.trunk == SETTINGS.weights.posture.trunk / 4
    assert there.weights.posture.elbow == SETTINGS.weights.posture.elbow * 4
    assert Solution(2, yielding=1 / 2, root=1 / 8, limbs=1 / 4).apply(there) == SETTINGS


def test_who_has_the_smaller_root_weight_gives_way() -> None:
    source = touching_scene()
    scales = random_scales(len(source.bones))
    moved = []
    for yielding in (1 / 20, 20.0):
        solution = Solution(1, yielding=yielding)
        points = retarget(prepare(source, solution.apply(SETTINGS)), scales).points
        n_first = source.n_joints[0]
        displacement = np.linalg.norm(points - source.points, axis=-1).mean(axis=(0, 1))
        moved.append(displacement[[0, n_first]])
    # Person a's root must also rise and sink with its legs; b's hardly.
    assert moved[0][0] > 1.5 * moved[1][0]
    assert moved[1][1] > 5 * moved[0][1]


def test_each_body_of_a_plan_has_all_solutions_each_with_a_key_of_its_own() -> None:
    several = replace(PAPER, solutions=replace(PAPER.solutions, n=3))
    variations = plan_variations(several, BODIES, "CLIP")
    one = plan_variations(PAPER, BODIES, "CLIP")
    assert {v.name for v in variations} == {
        f"{v.name}{end}" for v in one for end in ("", "-1", "-2")
    }
    assert [v.solution.number for v in variations if v.name.startswith("b-uniform-0.75")] == [
        0,
        1,
        2,
    ]
    assert len({body_key(v.scales, v.solution) for v in variations}) == len(variations)


@pytest.mark.parametrize("wrong", [{"n": 0}, {"yielding": -1.0}, {"root": float("nan")}])
def test_settings_that_have_no_meaning_are_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match=f"solutions.{next(iter(wrong))} must be at least"):
        replace(DRAWN, **wrong)
