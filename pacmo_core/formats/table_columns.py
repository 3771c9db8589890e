"""A table of joints as columns: those of a CSV file, and what columns of CSV and Parquet mean.

A row a frame. Columns are ``time`` (seconds, optional) and ``person_a.JOINT.x``, ``.y``, ``.z`` of
each joint and person; others are ignored, but not those of a third person, and without times a
column ``frame`` must count every frame. The joints are those of person a's columns, in their order.
Facts are texts by name: ``parents`` (indices of joints separated by spaces, -1 for the root),
``unit``, ``up``, ``fps``: in CSV lines ``# name: text`` at the top, in Parquet the metadata.
"""

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.formats.base import FormatError
from pacmo_core.formats.tables import is_number, parse_rows, read_lines

TIME, FRAME = "time", "frame"
AXES = ("x", "y", "z")
_PREFIXES = ("person_a.", "person_b.")
_SEPARATORS = {";": "semicolons", "\t": "tabs"}
_OTHER_PERSON = re.compile(r"person_[^.]+(?=\.)", re.IGNORECASE)


@dataclass(frozen=True)
class Columns:
    """The content of a CSV or Parquet table.

    Parameters
    ----------
    facts : texts by name
    values : (T,) float64 by column
    """

    facts: Mapping[str, str]
    values: Mapping[str, NDArray[np.float64]]


def wanted_columns(file: Path, names: Sequence[str]) -> list[str]:
    """List the columns that a table of joints consists of.

    Raises
    ------
    FormatError
        If one of them comes twice, or is of a third person.
    """
    clock = TIME if TIME in names else FRAME
    wanted = [name for name in names if name == clock or name.startswith(_PREFIXES)]
    others = {found[0] for name in {*names} - {*wanted} if (found := _OTHER_PERSON.match(name))}
    if others:
        raise FormatError(
            file, f"columns of {min(others)}: wanted those of person_a and person_b alone"
        )
    twice = [name for name, count in Counter(wanted).items() if count > 1]
    if twice:
        raise FormatError(file, f"the column {twice[0]!r} comes twice")
    return wanted


def table_arrays(file: Path, columns: Columns) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of a table by the names that they have in an NPZ file.

    Raises
    ------
    FormatError
        If a coordinate of a joint is missing, or a fact is not what it must be.
    """
    arrays: dict[str, NDArray[np.generic]] = _fact_arrays(file, columns.facts)
    if TIME in columns.values:
        arrays["times"] = columns.values[TIME]
    elif FRAME in columns.values:
        _check_frames(file, columns.values[FRAME])
    joints: list[str] = []
    for prefix in _PREFIXES:
        own = _joints(file, columns, prefix)
        joints = joints or own
        if own and set(own) != set(joints):
            differing = sorted(set(own) ^ set(joints))
            raise FormatError(file, f"only one person has the joint {differing[0]!r}")
        if own:
            flat = [columns.values[f"{prefix}{joint}.{axis}"] for joint in joints for axis in AXES]
            arrays[prefix[:-1]] = np.stack(flat, axis=1).reshape(-1, len(joints), 3)
    if joints:
        arrays["joints"] = np.array(joints)
    return arrays


def _check_frames(file: Path, frames: NDArray[np.float64]) -> None:
    """Refuse numbers of frames of which some are missing: the motion would jump."""
    jumps = np.flatnonzero(np.diff(frames) != 1)
    if len(jumps):
        before, after = frames[jumps[0]], frames[jumps[0] + 1]
        raise FormatError(
            file,
            f"the column {FRAME} goes from {before:g} to {after:g}: wanted every frame, or a "
            f"column {TIME}",
        )


def csv_arrays(file: Path) -> dict[str, NDArray[np.generic]]:
    """Read a CSV file as the arrays of a table.

    Raises
    ------
    FormatError
        If a line is not what it must be: with its number.
    """
    lines = read_lines(file)
    n_facts = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    facts = _csv_facts(file, lines[:n_facts])
    rows = [(n, line) for n, line in enumerate(lines[n_facts:], n_facts + 1) if line.strip()]
    if not rows:
        raise FormatError(file, "wanted a line with the names of the columns")
    numbers, header = [number for number, _ in rows], rows[0][1]
    separator = next((word for s, word in _SEPARATORS.items() if s in header), "")
    if separator and "," not in header:
        raise FormatError(file, f"columns separated by {separator}: wanted commas", numbers[0])
    words = _split(file, rows)
    wanted = wanted_columns(file, words[0])
    at = [words[0].index(name) for name in wanted]
    texts = [",".join(row[i] for i in at) for row in words[1:]]
    table = parse_rows(file, texts, numbers[1:], width=len(wanted), delimiter=",")
    return table_arrays(file, Columns(facts, dict(zip(wanted, table.T, strict=True))))


def _split(file: Path, rows: Sequence[tuple[int, str]]) -> list[list[str]]:
    """Split each line into words, of which every line has as many as the first."""
    result: list[list[str]] = []
    for line, text in rows:
        try:
            (words,) = csv.reader([text], strict=True)
        except csv.Error as error:
            raise FormatError(file, f"no comma-separated values: {error}", line) from error
        if result and len(words) != len(result[0]):
            raise FormatError(file, f"wanted {len(result[0])} values; got {len(words)}", line)
        result.append(words)
    return result


def _csv_facts(file: Path, lines: Sequence[str]) -> dict[str, str]:
    facts: dict[str, str] = {}
    for line, text in enumerate(lines, start=1):
        # Spreadsheets fill a line up with commas.
        name, colon, value = (word.strip() for word in text.strip("#, \t").partition(":"))
        if colon and name in facts:
            raise FormatError(file, f"{name} comes twice", line)
        if colon:
            facts[name] = value
    return facts


def _joints(file: Path, columns: Columns, prefix: str) -> list[str]:
    """List a person's joints in the order of the columns; each must have x, y and z."""
    names = [name.removeprefix(prefix) for name in columns.values if name.startswith(prefix)]
    parts = [name.rpartition(".") for name in names]
    joints = list(dict.fromkeys(joint for joint, _, _ in parts))
    for joint, _, axis in parts:
        if not joint or axis not in AXES:
            name = f"{prefix}{joint}.{axis}" if joint else f"{prefix}{axis}"
            raise FormatError(file, f"the column {name!r}: wanted {prefix}JOINT.x, .y or .z")
    present = set(names)
    for joint in joints:
        missing = [axis for axis in AXES if f"{joint}.{axis}" not in present]
        if missing:
            raise FormatError(file, f"no column {f'{prefix}{joint}.{missing[0]}'!r}")
    return joints


def _fact_arrays(file: Path, facts: Mapping[str, str]) -> dict[str, NDArray[np.generic]]:
    arrays: dict[str, NDArray[np.generic]] = {}
    for name in ("fps", "unit", "up"):
        if name in facts and name != "up" and is_number(facts[name].encode()):
            arrays[name] = np.array(float(facts[name]))
        elif name == "fps" and name in facts:
            raise FormatError(file, f"{name}: wanted a number; got {facts[name][:40]!r}")
        elif name in facts:
            arrays[name] = np.array(facts[name])  # a unit may be a word, such as mm
    if "parents" in facts:
        arrays["parents"] = _parents(file, facts["parents"])
    return arrays


def _parents(file: Path, text: str) -> NDArray[np.generic]:
    words = text.split()
    wrong = [w for w in words if not (w == "-1" or (w.isascii() and w.isdigit() and len(w) < 9))]
    if wrong:
        reason = f"wanted indices of joints separated by spaces; got {wrong[0][:40]!r}"
        raise FormatError(file, f"parents: {reason}")
    return np.array([int(word) for word in words], dtype=np.int64)
