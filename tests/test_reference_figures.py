"""What is trusted: deviations worked out by hand."""

import pytest

from benchmarks.reference_figures import deviations, nearest
from pacmo_core.metrics.catalogue import METRICS

REFERENCE = {"pacmo": {"real": {"f2id": 0.2, "ape": 0.0}, "pacmo": {"f2id": 0.02, "ape": 0.1}}}


def deviation(name: str, value: float) -> float:
    figures = {"pacmo": {row: dict(cells) for row, cells in REFERENCE["pacmo"].items()}}
    figures["pacmo"]["pacmo"][name] = value
    return dict(deviations(figures, REFERENCE))[f"pacmo.pacmo.{name}"]


def test_equal_figures_do_not_deviate_even_where_they_are_zero():
    assert set(dict(deviations(REFERENCE, REFERENCE)).values()) == {0.0}


def test_a_difference_is_relative_to_the_figure_or_to_that_of_real_motion():
    assert deviation("ape", 0.11) == pytest.approx(0.01 / (METRICS["ape"].tolerance * 0.1))
    assert deviation("f2id", 0.07) == pytest.approx(0.05 / (METRICS["f2id"].tolerance * 0.2))


def test_a_figure_that_is_missing_is_beyond_every_tolerance():
    assert dict(deviations({}, REFERENCE))["pacmo.pacmo.f2id"] == float("inf")


def test_a_figure_that_is_not_a_number_is_beyond_every_tolerance():
    assert deviation("f2id", float("nan")) == float("inf")


def test_figures_are_compared_with_the_reference_that_they_are_nearest_to():
    other = {"pacmo": {**REFERENCE["pacmo"], "pacmo": {"f2id": 0.03, "ape": 0.2}}}
    found = {"pacmo": {**REFERENCE["pacmo"], "pacmo": {"f2id": 0.03, "ape": 0.21}}}
    number, result = nearest(found, [REFERENCE, other])
    assert number == 2
    assert result == dict(deviations(found, other))
    assert nearest(REFERENCE, [REFERENCE, other])[0] == 1
