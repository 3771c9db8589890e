"""Truth: limits written down here."""

from dataclasses import replace
from math import inf, nan

import pytest

from pacmo_core.augmentation.keep import Bounds, excess, reason_of, worst

BOUNDS = Bounds(
    raw_residual=0.01,
    contacts_kept=0.9,
    added_slide=0.01,
    penetration=0.01,
    seam_ratio=1.5,
    flip_share=0.02,
    trunk_change=0.5,
)
GOOD = {
    "raw_residual": 0.001,
    "contacts_kept": 0.95,
    "added_slide": -0.001,
    "penetration": 0.01,
    "seam_ratio": 1.2,
    "flip_share": 0.0,
    "trunk_change": 0.1,
}


def test_a_variation_at_its_limits_is_good() -> None:
    assert excess(GOOD, BOUNDS) == {}
    assert reason_of(GOOD, BOUNDS) == ""
    assert worst(GOOD, BOUNDS) == 1


def test_what_is_beyond_a_limit_is_said_the_worst_first() -> None:
    bad = GOOD | {"contacts_kept": 0.7, "seam_ratio": 3.0}
    assert excess(bad, BOUNDS) == pytest.approx({"contacts_kept": 3.0, "seam_ratio": 2.0})
    assert reason_of(bad, BOUNDS) == (
        "contacts_kept 0.7, wanted at least 0.9; seam_ratio 3, wanted at most 1.5"
    )
    assert worst(bad, BOUNDS) == pytest.approx(3.0)


def test_what_is_no_number_is_beyond_its_limit() -> None:
    broken = GOOD | {"raw_residual": nan}
    assert list(excess(broken, BOUNDS)) == ["raw_residual"]
    assert worst(broken, BOUNDS) == inf
    assert "raw_residual nan" in reason_of(broken, BOUNDS)


def test_a_limit_of_nothing_lets_nothing_through() -> None:
    strict = replace(BOUNDS, penetration=0.0, contacts_kept=1.0)
    assert set(excess(GOOD, strict)) == {"penetration", "contacts_kept"}
    assert excess(GOOD | {"penetration": 0.0, "contacts_kept": 1.0}, strict) == {}
