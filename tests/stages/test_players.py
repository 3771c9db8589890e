"""Truth: answers put at known distances from what was captured."""

from dataclasses import replace

import numpy as np

from stages.report.players import alternate_actions, error, extremes
from tests.figures.samples import interaction


def test_an_error_is_how_far_joints_are_apart() -> None:
    seen = interaction(1)
    moved = replace(seen, person_b=seen.person_b + np.float32([0.0, 0.3, 0.4]))
    assert abs(error(seen, moved) - 0.5) < 1e-6


def test_best_median_and_worst_are_named_each_once() -> None:
    told = extremes({"d": 0.4, "a": 0.1, "c": 0.3, "b": 0.2, "e": 0.9})
    assert [(name, text.split()[0]) for name, text in told.items()] == [
        *(("a", "Best"), ("c", "Median"), ("e", "Worst"))
    ]
    assert list(extremes({"a": 0.1})) == ["a"]
    assert list(extremes({"a": 0.1, "b": 0.2})) == ["a", "b"]
    assert extremes({}) == {}


def test_the_rest_alternate_between_actions() -> None:
    clips = {name: (name[0], interaction(1)) for name in ("p1", "p2", "q1", "q2", "r1")}
    assert list(alternate_actions(clips)) == ["p1", "q1", "r1", "p2", "q2"]
