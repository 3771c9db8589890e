"""Compare the outputs of two runs by value: names of files, columns and keys may differ.

Usage: python -m benchmarks.compare_runs BEFORE AFTER [--significant N] [--json]

``BEFORE`` and ``AFTER`` are two checkouts in which ``./run`` has ended. For a change that renames
and moves but must not change a number. Every column of every Parquet and CSV file under ``data``,
``models`` and ``reports`` of ``BEFORE`` must be in a file of ``AFTER`` with equal values
in the same order; so must every tensor of every safetensors file, every number of the JSON files
and every number in the tables of the report. Columns of text hold names and are compared as
groups: rows that had equal text must have equal text again. Prints a line for each file that has
no equal.
"""

import argparse
import hashlib
import html
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from safetensors.numpy import load_file

from benchmarks._figures import arguments, show

FOLDERS = ("data", "models", "reports")
MAX_SHOWN = 5
NUMBER = re.compile(r"[-−+]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?")
CELL = re.compile(r"<t[dh][^>]*>(.*?)</t[dh]>", re.DOTALL)

Values = Counter[str]


def digest(values: np.ndarray, significant: int) -> str:
    """Hash an array by its values and shape, whatever its name.

    Parameters
    ----------
    significant : decimal digits that count; 0 for all bits
    """
    array = np.ascontiguousarray(values)
    if significant and array.dtype.kind == "f":
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 10.0 ** (significant - 1 - np.floor(np.log10(np.abs(array.astype(float)))))
            rounded = np.round(array * scale) / scale
        array = np.where(np.isfinite(rounded), rounded, array)
    return hashlib.sha256(
        repr((array.shape, array.dtype.str)).encode() + array.tobytes()
    ).hexdigest()


def columns(frame: pl.DataFrame, significant: int) -> Iterator[tuple[str, str]]:
    """Hash every column of a table; text by which rows are equal."""
    for series in frame.iter_columns():
        while series.dtype in (pl.List, pl.Array):
            series = series.explode()
        if series.dtype == pl.Struct:
            yield from columns(series.struct.unnest(), significant)
        elif series.dtype.is_numeric() or series.dtype == pl.Boolean:
            yield series.name, digest(series.to_numpy(), significant)
        else:
            codes: dict[object, int] = {}
            groups = [codes.setdefault(value, len(codes)) for value in series.to_list()]
            yield series.name, digest(np.array(groups, np.int64), 0)


def numbers(value: Any) -> Iterator[float]:
    """List the numbers of a JSON document."""
    if isinstance(value, dict):
        for item in value.values():
            yield from numbers(item)
    elif isinstance(value, list):
        for item in value:
            yield from numbers(item)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield float(value)


def contents(path: Path, significant: int) -> Values:
    """Count the values of a file: columns, tensors, numbers or cells of tables."""
    values: list[str] = []
    match path.suffix:
        case ".parquet":
            values = [value for _, value in columns(pl.read_parquet(path), significant)]
        case ".csv":
            values = [value for _, value in columns(pl.read_csv(path), significant)]
        case ".safetensors":
            values = [digest(tensor, significant) for tensor in load_file(path).values()]
        case ".json":
            document = json.loads(path.read_text("utf-8"))
            values = [f"%.{significant or 17}g" % number for number in numbers(document)]
        case ".html":
            cells = CELL.findall(path.read_text("utf-8"))
            text = " ".join(html.unescape(re.sub("<[^>]*>", " ", cell)) for cell in cells)
            values = NUMBER.findall(text)
    return Counter(values)


def read(root: Path, significant: int) -> dict[Path, Values]:
    """Read every file of a checkout that holds values."""
    files = [path for folder in FOLDERS for path in sorted((root / folder).rglob("*"))]
    values_of = {p.relative_to(root): contents(p, significant) for p in files if p.is_file()}
    return {path: values for path, values in values_of.items() if values}


def missing(before: dict[Path, Values], after: dict[Path, Values]) -> Iterator[tuple[Path, Values]]:
    """Yield the values of each file that no counterpart has.

    Tables and weights have one counterpart, the file with most values in common; the numbers of
    JSON files and reports may have moved to another file, so that all of them are searched.
    """
    pools = {suffix: _pool(after, suffix) for suffix in (".json", ".html")}
    for path, values in before.items():
        if path.suffix in pools:
            pool = pools[path.suffix]
            missing_values = Counter({v: n for v, n in values.items() if v not in pool})
        else:
            same_kind = [v for p, v in after.items() if p.suffix == path.suffix]
            nearest = max(same_kind, key=lambda other: (values & other).total(), default=Counter())
            missing_values = values - nearest
        if missing_values:
            yield path, missing_values


def _pool(files: dict[Path, Values], suffix: str) -> Values:
    return sum((values for path, values in files.items() if path.suffix == suffix), Counter())


def main() -> int:
    """Read the command line, compare, print."""
    parser = arguments(__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument(
        "--significant", type=int, default=0, help="decimal digits that must be equal; 0: all bits"
    )
    options: argparse.Namespace = parser.parse_args()
    before, after = (read(root, options.significant) for root in (options.before, options.after))
    if not before:
        sys.exit(
            f"{options.before}: wanted the outputs of a run below {', '.join(FOLDERS)}; got none"
        )
    missing_values = dict(missing(before, after))
    for path, values in missing_values.items():
        some = ", ".join(value[:24] for value in list(values)[:MAX_SHOWN])
        print(f"{path}: {values.total()} of {before[path].total()} values missing: {some}")
    figures = {
        "files": len(before),
        "values": sum(values.total() for values in before.values()),
        "files_that_differ": len(missing_values),
        "values_that_differ": sum(values.total() for values in missing_values.values()),
    }
    show(figures, as_json=options.json)
    return 1 if missing_values else 0


if __name__ == "__main__":
    sys.exit(main())
