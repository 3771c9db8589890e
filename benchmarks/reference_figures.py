"""Compare reports/metrics.json of the default with the figures of the machine that made dvc.lock.

Usage: python -m benchmarks.reference_figures [--json] [--update]

Trainings on another kind of processor round differently: hashes in ``dvc.lock`` change, figures
stay within the tolerances of pacmo_core/metrics/catalogue.py. A tolerance is relative to the
reference figure, or to that of real motion where this is larger: differences below the noise floor
mean nothing. A figure beyond its tolerance points to a mistake. ``--update`` writes the reference.
"""

import json
import math
import sys
from collections.abc import Iterator
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


def main() -> int:
    """Read the command line, compare, print."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("--update", action="store_true", help="write the reference")
    given = parser.parse_args()
    if not FIGURES.exists():
        sys.exit(f"no {FIGURES}: ./run makes it")
    figures: Tables = json.loads(FIGURES.read_text(encoding="utf-8"))
    if given.update:
        write_text(REFERENCE, json.dumps(figures, indent=2) + "\n")
    result = dict(deviations(figures, json.loads(REFERENCE.read_text(encoding="utf-8"))))
    beyond = {name: value for name, value in result.items() if value > 1}
    for name, value in beyond.items():
        print(f"{name}: {value:.2f} times its tolerance from the reference")
    figures_shown = {"figures": len(result), "beyond_tolerance": len(beyond)}
    show(figures_shown | {"largest_deviation": max(result.values())}, as_json=given.json)
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
