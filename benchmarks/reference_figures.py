"""Compare reports/metrics.json of the default with figures of the kinds of processor that made it.

Usage: python -m benchmarks.reference_figures [--json] [--update | --add]

Trainings on another kind of processor round differently: hashes in ``dvc.lock`` change, other
variations are accepted, and a figure may differ as between two seeds. So there is a reference of
each kind that the default was made on, first that of ``dvc.lock``; of others PaCMO's figures alone
where the variations have changed since. The figures are compared with
the one that they are nearest to, within the tolerances of pacmo_core/metrics/catalogue.py. A
tolerance is relative to the reference figure, or to that of real motion where this is larger:
differences below the noise floor mean nothing. A figure beyond its tolerance points to a mistake,
or to a further kind of processor. ``--update`` replaces all references by one, ``--add`` adds one.
"""

import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks._figures import arguments, show
from pacmo_core.metrics.catalogue import METRICS
from pacmo_core.store.files import write_text

FIGURES = Path("reports/metrics.json")
REFERENCE = Path(__file__).with_name("reference_figures.json")

Tables = dict[str, dict[str, dict[str, float]]]


def deviations(figures: Tables, reference: Tables) -> Iterator[tuple[str, float]]:
    """Yield each figure's name and its deviation in units of its tolerance; 1 is the limit."""
    for table, rows in reference.items():
        real = rows.get("real", {})
        for row, columns in rows.items():
            values = figures.get(table, {}).get(row, {})
            for name, expected in columns.items():
                tolerance = METRICS[name].tolerance
                allowed = tolerance * max(abs(expected), abs(real.get(name, 0.0)))
                difference = abs(values.get(name, float("inf")) - expected)
                if math.isnan(difference):
                    difference = float("inf")
                deviation = difference / allowed if allowed else float("inf")
                yield f"{table}.{row}.{name}", deviation if difference else 0.0


def nearest(figures: Tables, references: Sequence[Tables]) -> tuple[int, dict[str, float]]:
    """Return the number of the reference that figures deviate from least, from 1, and how far."""
    found = [dict(deviations(figures, reference)) for reference in references]
    best = min(range(len(found)), key=lambda number: max(found[number].values()))
    return best + 1, found[best]


def main() -> int:
    """Read the command line, compare, print."""
    parser = arguments(__doc__.splitlines()[0])
    writes = parser.add_mutually_exclusive_group()
    writes.add_argument("--update", action="store_true", help="replace all references by one")
    writes.add_argument("--add", action="store_true", help="add one, of a further kind")
    given = parser.parse_args()
    if not FIGURES.exists():
        sys.exit(f"no {FIGURES}: ./run makes it")
    figures: Tables = json.loads(FIGURES.read_text(encoding="utf-8"))
    references: list[Tables] = json.loads(REFERENCE.read_text(encoding="utf-8"))
    if given.update or given.add:
        references = [figures] if given.update else [*references, figures]
        write_text(REFERENCE, json.dumps(references, indent=2) + "\n")
    number, result = nearest(figures, references)
    beyond = {name: value for name, value in result.items() if value > 1}
    for name, value in beyond.items():
        print(f"{name}: {value:.2f} times its tolerance from reference {number}")
    shown = {"reference": number, "figures": len(result), "beyond_tolerance": len(beyond)}
    show(shown | {"largest_deviation": max(result.values())}, as_json=given.json)
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
