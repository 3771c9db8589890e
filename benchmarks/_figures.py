"""Output of all benchmarks: a line for each figure, and on request one JSON object at the end."""

import argparse
import json
from collections.abc import Mapping


def arguments(description: str) -> argparse.ArgumentParser:
    """Return the parser with the options of all benchmarks."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", action="store_true", help="print one JSON object at the end")
    return parser


def show(figures: Mapping[str, float], *, as_json: bool) -> None:
    """Print the figures."""
    for name, value in figures.items():
        print(f"{name:32} {value:.6g}", flush=True)
    if as_json:
        print(json.dumps({name: float(f"{value:.6g}") for name, value in figures.items()}))
