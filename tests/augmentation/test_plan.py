"""Truth: counts by hand; that a plan which grows leaves the rest of it as it was."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.augmentation.bodies import Population
from pacmo_core.augmentation.plan import Plan, SingleBones, plan_variations
from pacmo_core.augmentation.solutions import SolutionSettings
from tests.augmentation.test_bodies import body
from tests.data.test_segments import CMU22, DUO27

STEPS = tuple(round(0.75 + 0.05 * step, 2) for step in range(11))
PAPER = Plan(
    people=("a", "b"),
    uniform=STEPS,
    single=SingleBones(bones=("upper",), scales=STEPS, max_variations=10_000),
    profiles=(),
    n_random=0,
    population=Population(stature=0.05, proportion=0.04, random_seed=1),
    solutions=SolutionSettings(n=1, yielding=1.5, root=1.0, limbs=0.7, random_seed=2),
)
BODIES = (body(DUO27), body(DUO27))


def by_name(plan: Plan, source: str = "CLIP", bodies=BODIES) -> dict[str, tuple]:
    variations = plan_variations(plan, bodies, source)
    assert [v.name for v in variations] == sorted({v.name for v in variations})
    return {v.name: (v.kind, *(s.tolist() for s in v.scales)) for v in variations}


def test_the_papers_plan_has_ten_scales_of_all_bones_and_of_each_upper_one() -> None:
    variations = by_name(PAPER)
    n_upper = sum(segment.is_upper for segment in BODIES[0].segments)
    assert n_upper == 18
    assert len(variations) == 2 * 10 + 2 * 10 * n_upper
    kind, a, b = variations["b-uniform-0.75"]
    assert (kind, set(a), set(b)) == ("uniform", {1.0}, {0.75})
    kind, a, b = variations["a-left_forearm-1.20"]
    assert (kind, sorted(set(a)), set(b)) == ("single", [1.0, 1.2], {1.0})
    bone = [s.name for s in BODIES[0].segments].index("left_forearm")
    assert a[bone] == 1.2


def test_profiles_and_random_bodies_have_descriptive_names() -> None:
    plan = replace(PAPER, uniform=(), profiles=("child",), n_random=3, people=("b",))
    plan = replace(plan, single=SingleBones(bones=("left_*arm",), scales=(0.8,), max_variations=9))
    variations = by_name(plan)
    assert set(variations) == {
        *("b-child", "b-left_forearm-0.80", "b-left_upper_arm-0.80"),
        *("r0000", "r0001", "r0002"),
    }
    _, a, b = variations["r0001"]
    assert a != b
    assert by_name(replace(plan, n_random=4)).items() >= variations.items()


def test_single_bones_are_selected_by_their_names_alone() -> None:
    limited = replace(PAPER, single=replace(PAPER.single, max_variations=30), uniform=())
    selected = by_name(limited)
    assert len(selected) == 30
    assert selected.items() <= by_name(PAPER).items()
    assert by_name(limited, "OTHER").keys() != selected.keys()
    assert by_name(replace(limited, uniform=(0.9,))).items() >= selected.items()


def test_two_people_may_have_different_skeletons() -> None:
    variations = by_name(replace(PAPER, uniform=(0.8,)), bodies=(body(DUO27), body(CMU22)))
    _, a, b = variations["a-left_forearm-0.75"]
    assert (len(a), len(b)) == (26, 21)
    assert "b-lowerback-1.25" in variations
    assert "a-lowerback-1.25" not in variations


def test_scales_that_round_alike_have_names_that_differ() -> None:
    plan = replace(PAPER, uniform=(0.8, 0.801), single=replace(PAPER.single, max_variations=0))
    assert set(by_name(plan)) >= {"a-uniform-0.80", "a-uniform-0.801"}


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_a_scale_that_is_not_positive_is_refused_by_the_plan(scale: float) -> None:
    with pytest.raises(ValueError, match="scales of a plan must be positive numbers; got"):
        replace(PAPER, uniform=(scale,))
    with pytest.raises(ValueError, match="scales of a plan must be positive numbers; got"):
        replace(PAPER, single=replace(PAPER.single, scales=(scale,)))


def test_a_pattern_without_match_is_refused_with_the_known_names() -> None:
    plan = replace(PAPER, single=SingleBones(bones=("*tail",), scales=(0.8,), max_variations=1))
    with pytest.raises(
        ValueError, match=r"no segment matches '\*tail'; there are upper, head, left"
    ):
        by_name(plan)
    with pytest.raises(ValueError, match="people must be of a, b; got c"):
        replace(PAPER, people=("c",))
