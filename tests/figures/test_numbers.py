"""Truth: a few numbers written out; that text reads back as the number it was made of."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacmo_core.figures.numbers import (
    format_estimate,
    format_fixed,
    format_number,
    format_printed,
    format_range,
    format_tick,
)

_PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")


def read(text: str) -> Decimal:
    """Read a number in the notation of reports."""
    mantissa, _, power = text.translate(_PLAIN).replace(",", "").partition("×10")
    return Decimal(mantissa).scaleb(int(power or 0))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (0.5, "0.500"), (12.34, "12.3"), (-0.25, "−0.250"), (512.4, "512"),
        (0.00004567, "4.57×10⁻⁵"), (1234567.0, "1.23×10⁶"), (99.96, "100"), (9.996, "10.0"),
        (0.001, "0.00100"), (36000.0, "36,000"), (99999.0, "1.00×10⁵"),
    ],
)  # fmt: skip
def test_numbers_are_short_and_keep_the_digits_that_count(value: float, text: str) -> None:
    assert format_number(value) == text


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [
        (12.34, 1, "12.3"), (-0.314, 2, "−0.31"), (-0.004, 2, "0"), (3e-6, 1, "0"), (0.0, 2, "0"),
        (-0.0, 1, "0"), (1234.5, 2, "1,234.50"), (0.05, 0, "0"), (100.0, 0, "100"),
    ],
)  # fmt: skip
def test_fixed_decimals_end_at_nothing(value: float, decimals: int, text: str) -> None:
    assert format_fixed(value, decimals) == text


@given(st.floats(allow_nan=False, allow_infinity=False).filter(lambda x: not 0 < abs(x) < 1e-290))
def test_a_number_is_read_back_to_three_digits(value: float) -> None:
    text = format_number(value)
    assert abs(read(text) - Decimal(value)) <= abs(Decimal(value)) * Decimal("0.00501")
    assert "e" not in text


@pytest.mark.parametrize(
    ("printed", "text"),
    [
        ("0.001", "0.001"), ("5.80e-3", "0.00580"), ("494.9e-4", "0.04949"), ("0", "0"),
        ("1.6e-4", "1.6×10⁻⁴"), ("-2.50", "−2.50"),
    ],
)  # fmt: skip
def test_printed_digits_stay(printed: str, text: str) -> None:
    assert format_printed(printed) == text
    assert read(text) == Decimal(printed)


def test_ticks_have_no_needless_digits() -> None:
    ticks = {1.0: "1", 0.25: "0.25", 1000.0: "1,000", 1e-5: "10⁻⁵", -2e-5: "−2×10⁻⁵", 0.0: "0"}
    assert {value: format_tick(value) for value in ticks} == ticks


def test_intervals_are_written_in_one_way() -> None:
    assert format_range(-0.05, 0.2) == "−0.0500 to 0.200"
    assert format_estimate({"mean": 0.1, "low": 0.05, "high": 0.2}) == "0.100 (0.0500 to 0.200)"
    assert format_estimate({"mean": 0.1}) == "0.100"
