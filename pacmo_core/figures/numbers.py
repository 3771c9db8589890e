"""The one notation of numbers: three significant digits, a minus sign, powers of ten.

Measurements with a unit have a fixed number of decimals instead (``format_fixed``).
"""

from collections.abc import Mapping
from decimal import Decimal
from math import floor, log10

# Sizes that are written without a power of ten.
PLAIN_FROM, PLAIN_BELOW = 1e-3, 1e5
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def format_number(value: float) -> str:
    """Format a number with three significant digits: 0.500, −12.3, 36,000, 4.57×10⁻⁵."""
    size = abs(value)
    if not size:
        return "0"
    rounded = float(f"{size:.2e}")
    if PLAIN_FROM <= rounded < PLAIN_BELOW:
        text = f"{size:,.{max(0, 2 - floor(log10(rounded)))}f}"
    else:
        mantissa, _, exponent = f"{size:.2e}".partition("e")
        text = mantissa + _power(int(exponent))
    return f"−{text}" if value < 0 else text


def format_fixed(value: float, decimals: int) -> str:
    """Format a number with fixed decimals: 12.0, −0.31; 0 where all of them are zero."""
    text = f"{abs(value):,.{decimals}f}"
    if not text.strip("0.,"):
        return "0"
    return f"−{text}" if value < 0 else text


def format_tick(value: float) -> str:
    """Format a value with as many digits as it needs, for the ticks of an axis: 1, 0.25, 10⁻⁵."""
    size = abs(float(f"{value:.12g}"))
    if not size or PLAIN_FROM <= size < PLAIN_BELOW:
        text = f"{size:,g}" if size < 1e4 else f"{size:,.0f}"
    else:
        mantissa, _, exponent = f"{size:e}".partition("e")
        digits = f"{float(mantissa):g}"
        power = _power(int(exponent))
        text = power.removeprefix("×") if digits == "1" else digits + power
    return f"−{text}" if value < 0 and size else text


def format_printed(text: str) -> str:
    """Return a printed number in this notation, with the digits that were printed.

    ``5.80e-3`` becomes 0.00580: no digit is added or lost.
    """
    value = Decimal(text)
    if not value or -3 <= value.adjusted() < 5:
        return f"{value:f}".replace("-", "−")
    mantissa = value.scaleb(-value.adjusted())
    return f"{mantissa:f}".replace("-", "−") + _power(value.adjusted())


def format_range(low: float, high: float) -> str:
    """Format an interval: ``0.190 to 0.210``."""
    return f"{format_number(low)} to {format_number(high)}"


def format_estimate(cell: Mapping[str, float]) -> str:
    """Format a mean with its interval, if it has one: ``0.200 (0.190 to 0.210)``."""
    mean = format_number(cell["mean"])
    if "low" not in cell or "high" not in cell:
        return mean
    return f"{mean} ({format_range(cell['low'], cell['high'])})"


def _power(exponent: int) -> str:
    return "×10" + str(exponent).translate(_SUPERSCRIPTS)
