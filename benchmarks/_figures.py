"""How every benchmark speaks: a line a figure for people, or one JSON object last."""

import argparse
import json
from collections.abc import Mapping


def arguments(description: str) -> argparse.ArgumentParser:
    """Make the parser that all benchmarks share."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", action="store_true", help="print one JSON object last")
    return parser


def show(figures: Mapping[str, float], *, as_json: bool) -> None:
    """Print the figures."""
    for name, value in figures.items():
        print(f"{name:32} {value:.6g}", flush=True)
    if as_json:
        print(json.dumps({name: float(f"{value:.6g}") for name, value in figures.items()}))
