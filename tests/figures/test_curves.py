"""Truth: where a straight line, a power law and a gap must lie in a picture."""

import re

import numpy as np
import pytest

from pacmo_core.figures.curves import Curve, charts


def points(path: str) -> np.ndarray:
    return np.array([pair.split() for pair in re.split("[ML]", path.strip("Z"))[1:]], float)


def test_a_straight_line_is_drawn_straight_from_corner_to_corner() -> None:
    [chart] = charts(Curve([0, 1, 2, 3], {"loss": [4.0, 3.0, 2.0, 1.0]}))
    x, y = points(chart.line).T
    assert np.ptp(np.diff(x)) < 0.2
    assert np.ptp(np.diff(y)) < 0.2
    assert (x[0], x[-1]) == (chart.left, chart.right)
    assert y[-1] == chart.bottom > y[0]


def test_a_wide_positive_term_gets_a_logarithmic_axis_with_powers_of_ten() -> None:
    [chart] = charts(Curve([0, 1, 2, 3], {"loss": [1000.0, 100.0, 10.0, 1.0]}))
    assert chart.is_log
    assert [tick.text for tick in chart.y_ticks] == ["1", "10", "100", "1,000"]
    assert np.ptp(np.diff(points(chart.line)[:, 1])) < 0.2


def test_ticks_stand_where_their_values_lie() -> None:
    [chart] = charts(Curve([0, 100], {"loss": [-2.0, 2.0]}))
    zero = next(tick for tick in chart.y_ticks if tick.text == "0")
    assert zero.at == pytest.approx(points(chart.line)[:, 1].mean(), abs=0.1)
    assert "−2" in [tick.text for tick in chart.y_ticks]


def test_steps_without_a_measurement_are_passed_over() -> None:
    [chart] = charts(Curve([0, 1, 2], {"loss": [2.0, float("nan"), 1.0], "none": [np.nan] * 3}))
    assert chart.name == "loss"
    assert len(points(chart.line)) == 2


def test_a_long_run_is_thinned_and_its_band_holds_every_value() -> None:
    values = np.random.default_rng(4).normal(size=10_000)
    [chart] = charts(Curve(list(range(10_000)), {"loss": values.tolist()}))
    assert len(points(chart.line)) == 240
    _, y = points(chart.band).T
    assert (y.min(), y.max()) == (8.0, chart.bottom)


@pytest.mark.parametrize("values", [[5.0], [0.0]])
def test_a_run_of_one_step_is_still_drawn(values: list[float]) -> None:
    [chart] = charts(Curve([1], {"loss": values}))
    assert np.isfinite(points(chart.line)).all()


def test_a_curve_of_unequal_lengths_is_refused() -> None:
    with pytest.raises(ValueError, match=r"got 2 steps and \{'loss': 1\}"):
        Curve([0, 1], {"loss": [1.0]})


def test_four_points_are_not_stretched_over_their_noise() -> None:
    [chart] = charts(Curve([1, 2, 3, 4], {"loss": [0.50, 0.51, 0.505, 0.502]}))
    y = points(chart.line)[:, 1]
    assert np.ptp(y) < 0.1 * (chart.bottom - 8.0)
    assert len(chart.dots) == 4
    assert [tick.text for tick in chart.x_ticks] == ["1", "2", "3", "4"]


def test_the_axis_holds_the_interval_of_every_point() -> None:
    curve = Curve([1, 2], {"f2id": [0.1, 0.2]}, intervals={"f2id": ([-0.9, 0.1], [1.0, np.nan])})
    [chart] = charts(curve)
    line, band = (points(path)[:, 1] for path in (chart.line, chart.band))
    assert (band.min(), band.max()) == (8.0, chart.bottom)
    assert np.ptp(line) == pytest.approx(0.1 / 1.9 * (chart.bottom - 8.0), abs=0.1)


def test_a_long_curve_has_no_dots() -> None:
    [chart] = charts(Curve(list(range(100)), {"loss": [1.0 + k for k in range(100)]}))
    assert chart.dots == ()


def test_whole_steps_have_whole_ticks() -> None:
    [chart] = charts(Curve([1, 2], {"loss": [2.0, 1.0]}))
    assert [tick.text for tick in chart.x_ticks] == ["1", "2"]
