"""Tables of metrics with intervals, for the page and as Markdown."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

Cell = Mapping[str, float | str | None]  # mean, low, high; without a mean, the reason as "missing"
Rows = Mapping[str, Mapping[str, Cell]]

LOWER, CLOSER, HIGHER, UNKNOWN = "↓", "→", "↑", ""
_NO_VALUE, _NO_REASON = "–", "not computed for this row"


@dataclass(frozen=True)
class Metric:
    """How a metric is written, and which way is better (``→``: closer to the row ``real``)."""

    label: str
    better: str
    unit: str
    meaning: str


METRICS = {
    "f2id": Metric("F²ID", LOWER, "", "distance of the laws of the features of interactions"),
    "f2id_excess": Metric("F²ID excess", LOWER, "", "F²ID above its floor"),
    "fid": Metric("FID", LOWER, "", "distance of the laws of the features of clips"),
    "mmd_a": Metric("MMD-A", LOWER, "", "maximum mean discrepancy, frame by frame"),
    "mmd_s": Metric("MMD-S", LOWER, "", "maximum mean discrepancy of whole clips"),
    "diversity": Metric("Diversity", CLOSER, "", "squared distance of the features of two clips"),
    "matching": Metric("Matching", HIGHER, "", "how often reaction and partner are told to belong"),
    "ape": Metric("APE", LOWER, "m", "average position error of the root"),
    "ave": Metric("AVE", LOWER, "m²", "average error of the root's variance over time"),
    "ape_joints": Metric("APE, joints", LOWER, "m", "average position error of all joints"),
    "ave_joints": Metric("AVE, joints", LOWER, "m²", "average variance error of all joints"),
    "f2id_published": Metric("F²ID", LOWER, "", "1,000 drawn with replacement, five times"),
    "mmd_a_published": Metric("MMD-A", LOWER, "", "biased, many bandwidths; at least 2/n"),
    "mmd_s_published": Metric("MMD-S", LOWER, "", "biased, many bandwidths; at least 2/n"),
    "diversity_published": Metric("Diversity", CLOSER, "", "over 500 disjoint pairs"),
    "e_r": Metric("E_r", LOWER, "", "reconstruction error"),
    "e_b": Metric("E_b", LOWER, "", "error of bone lengths"),
    "jpd": Metric("JPD", LOWER, "", "difference of the distances between the two bodies' joints"),
}

# What a first look shows; reports/metrics.json holds every metric.
MAIN_COLUMNS = ("f2id", "mmd_a", "mmd_s", "diversity", "ape", "ave")

ROWS = {
    "real": ("Real motion", "a second draw, from the training clips: the floor"),
    "oracle": ("Oracle", "a fresh draw from the true law: how good a score can get"),
    "pacmo": ("PaCMO", ""),
    "gru": ("GRU", "baseline"),
    "wrong_partner": ("Wrong partner", "real reactions, shuffled among partners"),
}
_NO_MODELS = {"real", "oracle", "wrong_partner"}


@dataclass(frozen=True)
class Entry:
    """One cell as shown; ``mark`` is ``best``, ``level`` (interval meets the best's) or empty."""

    value: str
    interval: str
    mark: str
    reason: str


@dataclass(frozen=True)
class Line:
    """One row as shown."""

    label: str
    meaning: str
    is_model: bool
    entries: tuple[Entry, ...]


@dataclass(frozen=True)
class Table:
    """A table as shown: the metrics are the columns."""

    metrics: tuple[Metric, ...]
    lines: tuple[Line, ...]

    @property
    def reasons(self) -> list[str]:
        """Why values are missing, each reason once, in the order of the cells."""
        given = [entry.reason for line in self.lines for entry in line.entries if entry.reason]
        return list(dict.fromkeys(given))


def table(rows: Rows) -> Table:
    """Lay out rows of metrics, marking the best model of each column.

    Known rows and metrics come first, in the order of this module; others follow in their own.
    The real motion, the oracle and the wrong partner are references and are never marked; nor
    is a model that has no rival, nor a metric whose better direction is not known.
    """
    names = _known_first(ROWS, rows)
    columns = _known_first(METRICS, {key: None for row in rows.values() for key in row})
    marks = {column: _marks(rows, column) for column in columns}
    return Table(
        metrics=tuple(METRICS.get(c, Metric(c, UNKNOWN, "", "")) for c in columns),
        lines=tuple(
            Line(
                *ROWS.get(name, (name, "")),
                is_model=name not in _NO_MODELS,
                entries=tuple(
                    _entry(rows[name].get(c, {}), marks[c].get(name, "")) for c in columns
                ),
            )
            for name in names
        ),
    )


def markdown_table(rows: Rows) -> str:
    """Write rows of metrics as a Markdown table: the best model bold, ``≈`` where level with it."""
    shown = table(rows)
    head = ["", *(f"{_plain(m.label)} {m.better}".strip() for m in shown.metrics)]
    body = [[_plain(line.label), *map(_markdown, line.entries)] for line in shown.lines]
    ruler = ["---", *["---:"] * len(shown.metrics)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [head, ruler, *body]) + "\n"


def number(value: float) -> str:
    """Write a number short: three digits that count, a true minus."""
    size = abs(value)
    if size and not 1e-3 <= size < 1e5:
        text = f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")
    else:
        text = f"{value:.0f}" if size >= 100 else f"{value:#.3g}".removesuffix(".") if size else "0"
    return text.replace("-", "−")


def _known_first(known: Mapping[str, object], given: Mapping[str, object]) -> list[str]:
    return [key for key in known if key in given] + [key for key in given if key not in known]


def _number_in(cell: Cell, key: str) -> float | None:
    value = cell.get(key)
    if isinstance(value, str) or value is None or math.isnan(value):
        return None
    return float(value)


def _entry(cell: Cell, mark: str) -> Entry:
    mean, low, high = (_number_in(cell, key) for key in ("mean", "low", "high"))
    if mean is None:
        return Entry(_NO_VALUE, "", "", str(cell.get("missing") or _NO_REASON))
    interval = "" if low is None or high is None else f"{number(low)} … {number(high)}"
    return Entry(number(mean), interval, mark, "")


def _marks(rows: Rows, column: str) -> dict[str, str]:
    """Say which models are best in a column, and whose intervals meet the best's."""
    better = METRICS[column].better if column in METRICS else UNKNOWN
    real = _number_in(rows.get("real", {}).get(column, {}), "mean")
    cells = {name: row.get(column, {}) for name, row in rows.items() if name not in _NO_MODELS}
    means = {name: m for name, cell in cells.items() if (m := _number_in(cell, "mean")) is not None}
    if len(means) < 2 or better == UNKNOWN or (better == CLOSER and real is None):
        return {}
    away = {LOWER: means, HIGHER: {name: -m for name, m in means.items()}}.get(
        better, {name: abs(m - (real or 0.0)) for name, m in means.items()}
    )
    best = min(away, key=away.__getitem__)
    level = {name: "level" for name in means if name != best and _meet(cells[name], cells[best])}
    return {best: "best"} | level


def _meet(one: Cell, other: Cell) -> bool:
    ends = [_number_in(cell, key) for cell in (one, other) for key in ("low", "high")]
    low, high, other_low, other_high = ends
    if low is None or high is None or other_low is None or other_high is None:
        return False
    return low <= other_high and other_low <= high


def _markdown(entry: Entry) -> str:
    value = f"**{entry.value}**" if entry.mark == "best" else entry.value
    level = "≈ " if entry.mark == "level" else ""
    return f"{level}{value}" + (f" ({entry.interval})" if entry.interval else "")


def _plain(text: str) -> str:
    """Keep a name from breaking out of its cell."""
    return " ".join(text.replace("\\", "\\\\").replace("|", "\\|").split())
