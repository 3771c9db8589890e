"""Measurements of variations in words, tables of them, and the worst variation by each."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.numbers import format_fixed
from pacmo_core.figures.tables import Entry, Line, Table, make_entry
from pacmo_core.figures.viewer import Panel, PlayedClip
from pacmo_core.metrics.catalogue import HIGHER, LOWER, UNKNOWN, Metric

Measurements = Mapping[str, float]

# Of a measured value, by its unit: further digits are below what anybody sees.
DECIMALS = {"mm": 1, "cm": 2, "cm/s": 2, "°": 1, "%": 1, "×": 2}


@dataclass(frozen=True)
class Measure:
    """A measurement as it is shown.

    Parameters
    ----------
    label, better, unit, meaning : as in ``metrics.catalogue.Metric``
    factor : from the measured value to the unit
    perfect : value, in the unit, of a variation without the fault; None where no variation is
        shown as the worst by it
    """

    label: str
    better: str
    unit: str
    meaning: str
    factor: float = 1.0
    perfect: float | None = None

    @property
    def metric(self) -> Metric:
        """The head of its column."""
        return Metric(self.label, self.better, self.unit, self.meaning)

    def number(self, value: float) -> str:
        """Return a measured value in the unit, with its decimals."""
        return format_fixed(self.factor * value, DECIMALS[self.unit])

    def text(self, value: float) -> str:
        """Return a measured value with its unit."""
        space = "" if self.unit in ("°", "×") else " "
        return f"{self.number(value)}{space}{self.unit}"

    def bound_text(self, limit: float) -> str:
        """Return a limit in words: ``at most 30.0°``."""
        return f"{'at least' if self.better == HIGHER else 'at most'} {self.text(limit)}"

    def fault(self, value: float) -> float:
        """Return by how much a value is worse than perfect; 0 or below where it has no fault."""
        excess = self.factor * value - (self.perfect or 0.0)
        return -excess if self.better == HIGHER else excess


# Every measurement that is shown or limited, by its name in variations.parquet.
MEASURES = {
    "near_distance_error": Measure(
        "Near distances",
        LOWER,
        "mm",
        "change of the distances between near joints of the two people",
        factor=1e3,
        perfect=0,
    ),
    "near_distance_error_naive": Measure(
        "Near, scaled", UNKNOWN, "mm", "the same if each body is only scaled", factor=1e3
    ),
    "contacts_kept": Measure(
        "Contacts kept",
        HIGHER,
        "%",
        "share of the source's contacts, over pairs and frames, by the same distance",
        factor=100,
        perfect=100,
    ),
    "contacts_kept_with_slack": Measure(
        "Contacts, with slack", HIGHER, "%", "the same, by a slightly larger distance", factor=100
    ),
    "knee_change_p95": Measure(
        "Knees", LOWER, "°", "95th percentile of the change of the angle", perfect=0
    ),
    "elbow_change_p95": Measure("Elbows", LOWER, "°", "the same of elbows", perfect=0),
    "shoulder_change_p95": Measure("Shoulders", LOWER, "°", "the same of shoulders"),
    "spine_change_p95": Measure("Spine", LOWER, "°", "the same within the spine", perfect=0),
    "spine_bend": Measure(
        "Spine, one joint", LOWER, "°", "by which it bends further, in the worst frame", perfect=0
    ),
    "pelvis_height_error": Measure(
        "Pelvis height",
        LOWER,
        "cm",
        "mean error, against the source's height times the leg's scale",
        factor=100,
        perfect=0,
    ),
    "support_height_error": Measure(
        "Feet's height",
        LOWER,
        "cm",
        "mean change of the height of the lowest supporting joint",
        factor=100,
        perfect=0,
    ),
    "trunk_change": Measure(
        "Trunk", LOWER, "%", "largest relative change of a distance within it", factor=100
    ),
    "below_floor": Measure(
        "Below the floor", LOWER, "cm", "depth of the lowest joint", factor=100, perfect=0
    ),
    "added_foot_skate": Measure(
        "Added foot skate",
        LOWER,
        "cm/s",
        "speed of feet in stance, in addition to the source's",
        factor=100,
        perfect=0,
    ),
    "capsule_penetration": Measure(
        "Penetration",
        LOWER,
        "cm",
        "depth of the bodies in each other, beyond that of the source",
        factor=100,
        perfect=0,
    ),
    "peak_acceleration_ratio": Measure(
        "Peak acceleration", LOWER, "×", "largest acceleration over that of the source", perfect=1
    ),
    "knee_flips": Measure(
        "Knee flips",
        LOWER,
        "%",
        "share of frames in which a knee bends to the other side",
        100,
        perfect=0,
    ),
    "elbow_flips": Measure("Elbow flips", LOWER, "%", "the same of elbows", 100, perfect=0),
    "seam_ratio": Measure(
        "Jumps",
        LOWER,
        "×",
        "largest acceleration of a frame over the median around it, relative to the source's",
    ),
    "primal_residual": Measure(
        "Bones before they are set to their length",
        LOWER,
        "%",
        "largest relative error of the solver; in the variation bones have their length exactly",
        100,
    ),
}
# Measurements that qualify the solver, not the motion, are in words where a limit names them only.
TABLE_MEASURES = tuple(name for name in MEASURES if name not in ("seam_ratio", "primal_residual"))
WORST_BY = tuple(name for name, measure in MEASURES.items() if measure.perfect is not None)

# What a command prints of a variation.
PRINTED = (
    "near_distance_error",
    "contacts_kept",
    "knee_change_p95",
    "elbow_change_p95",
    "spine_change_p95",
    "spine_bend",
    "pelvis_height_error",
    "support_height_error",
    "below_floor",
    "added_foot_skate",
    "capsule_penetration",
    "peak_acceleration_ratio",
    "seam_ratio",
)

_NO_LIMIT = make_entry({"missing": "no limit"}, "")

KINDS = {
    "uniform": ("One body scaled", "all bones by one factor"),
    "single": ("One bone", "of the upper body"),
    "profile": ("One profile", "child, tall adult, long arms"),
    "random": ("Two sampled bodies", "log-normal stature and proportions"),
}


def variation_label(name: str) -> str:
    """Return the name of a variation in words: ``b-left_forearm-1.20`` is of person b."""
    person, dash, body = name.partition("-")
    if not dash:
        return f"both bodies sampled, {name}"
    bone, _, scale = body.rpartition("-")
    if not bone:
        return f"{person}: {body.replace('_', ' ')}"
    bones = "all bones" if bone == "uniform" else bone.replace("_", " ")
    return f"{person}: {bones} × {scale}"


def measure_label(name: str) -> str:
    """Return a measurement's label within a sentence."""
    label = MEASURES[name].label if name in MEASURES else name.replace("_", " ")
    return label[0].lower() + label[1:]


def variation_table(kinds: Mapping[str, Mapping[str, Measurements]]) -> Table:
    """Return a table of each kind's measurements: means and percentiles."""
    return Table(
        metrics=tuple(MEASURES[name].metric for name in TABLE_MEASURES),
        lines=tuple(
            Line(
                *KINDS[kind],
                is_model=False,
                entries=tuple(
                    make_entry(_in_units(name, kinds[kind].get(name, {})), "")
                    for name in TABLE_MEASURES
                ),
            )
            for kind in KINDS
            if kind in kinds
        ),
    )


def _in_units(name: str, cell: Measurements) -> Measurements:
    return {key: MEASURES[name].factor * value for key, value in cell.items()}


def measurement_lines(
    measurements: Measurements, limits: Measurements, worse: Mapping[str, str]
) -> list[str]:
    """Return a line for each of ``PRINTED``: the value, its limit, and in whom it is worse.

    Parameters
    ----------
    measurements : those that are absent have no line
    limits : of those that have one
    worse : the person, of measurements that are those of a person
    """
    lines = []
    for name in (name for name in PRINTED if name in measurements):
        measure = MEASURES[name]
        notes = []
        if name == "near_distance_error":
            naive = "near_distance_error_naive"
            notes.append(f"{MEASURES[naive].text(measurements[naive])} if only scaled")
        if name in limits:
            notes.append(f"wanted {measure.bound_text(limits[name])}")
        if name in worse and measure.number(measurements[name]) != "0":
            notes.append(f"person {worse[name]}")
        value = measure.text(measurements[name])
        lines.append(f"  {measure_label(name):<18}{value:>11}  {', '.join(notes)}".rstrip())
    return lines


def limits_table(
    columns: Sequence[tuple[str, Measurements, Collection[str]]], limits: Measurements
) -> Table:
    """Return a table of variations: their measurements beside the limits.

    Marked: beyond its limit.

    Parameters
    ----------
    columns : of each variation its label, its measurements, and the names of those beyond limits
    """
    lines = []
    for name, measure in MEASURES.items():
        if name in columns[0][1]:
            label = " ".join(filter(None, (measure.label, measure.better, measure.unit)))
            entries = [
                Entry(measure.number(measurements[name]), "", "worst" if name in beyond else "", "")
                for _, measurements, beyond in columns
            ]
            limit = Entry(measure.number(limits[name]), "", "", "") if name in limits else _NO_LIMIT
            entries.append(limit)
            lines.append(Line(label, measure.meaning, is_model=False, entries=tuple(entries)))
    heads = [*(label for label, _, _ in columns), "Limit"]
    return Table(tuple(Metric(head, UNKNOWN, "", "") for head in heads), tuple(lines))


def limit_text(name: str, value: float, limit: float) -> str:
    """Return a measurement beyond its limit in words: ``knees 41.2°, wanted at most 30.0°``."""
    measure = MEASURES[name]
    return f"{measure_label(name)} {measure.text(value)}, wanted {measure.bound_text(limit)}"


def worst_by_measure(rows: Iterable[tuple[str, Measurements]]) -> dict[str, list[str]]:
    """Select the worst variation by each of ``WORST_BY``.

    A measurement by which no variation has a fault selects none; values that are not finite are
    passed over. Of equal values the first name is selected.

    Parameters
    ----------
    rows : name and measurements of each variation

    Returns
    -------
    by selected variation, the measurements by which it is the worst, in the order of ``WORST_BY``
    """
    known = sorted(rows, key=lambda row: row[0])
    selected: dict[str, list[str]] = {}
    for name in WORST_BY:
        measure = MEASURES[name]
        faults = {
            variation: measure.fault(measurements[name])
            for variation, measurements in known
            if isfinite(measurements.get(name, float("nan")))
        }
        worst = max(faults, key=faults.__getitem__, default="")
        if worst and faults[worst] > 0:
            selected.setdefault(worst, []).append(name)
    return selected


@dataclass(frozen=True)
class ShownVariation:
    """A variation of the gallery.

    Parameters
    ----------
    label : of its bodies
    measurements : of the solver's report
    motion : of both people
    worst_by : measurements by which it is the worst of all
    beyond : those beyond their limits, for which it is left out of training
    """

    label: str
    measurements: Measurements
    motion: Interaction
    worst_by: Sequence[str] = ()
    beyond: Sequence[str] = ()

    @property
    def caption(self) -> str:
        """What it is the worst by, and whether it is left out, as the end of a sentence."""
        parts = [
            f"{measure_label(name)} ({MEASURES[name].text(self.measurements[name])})"
            for name in self.worst_by
        ]
        worst = f"is the worst by {', '.join(parts)}" if parts else ""
        reasons = ", ".join(map(measure_label, self.beyond))
        return "; ".join(filter(None, (worst, reasons and f"left out of training for {reasons}")))


def played_variation(
    name: str, source: Interaction, variations: Sequence[ShownVariation], limits: Measurements
) -> PlayedClip:
    """Return variations beside their source as a clip to play, their measurements and limits."""
    columns = [(shown.label, shown.measurements, shown.beyond) for shown in variations]
    panels = [Panel(shown.label, shown.motion) for shown in variations]
    return PlayedClip(
        name,
        "",
        (Panel("Source", source), *panels),
        captions=tuple((shown.label, shown.caption) for shown in variations if shown.caption),
        table=limits_table(columns, limits),
    )
