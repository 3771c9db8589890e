"""Motions as tables of joints, NPZ, CSV or Parquet, which ``pacmo_core.formats.table`` reads."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.resample import frame_rate
from pacmo_core.formats.table_columns import AXES, TIME
from pacmo_core.formats.table_parquet import parquet_bytes

PEOPLE = ("person_a", "person_b")


@dataclass(frozen=True)
class JointTable:
    """One or two people, as a table states them.

    Parameters
    ----------
    skeleton : of all people
    times : (T,) float64, seconds
    people : one or two of (T, J, 3) float32, in the unit and axes below
    up : the axis that is up, ``y`` or ``z``
    unit : metres per unit
    """

    skeleton: Skeleton
    times: NDArray[np.float64]
    people: Sequence[Motion]
    up: str
    unit: float

    @property
    def fps(self) -> float:
        """Frames a second: the inverse of the median time between frames."""
        return frame_rate(self.times)


def npz_table(table: JointTable) -> bytes:
    """Write ``person_a``, ``person_b`` (T, J, 3) float32 and their description; no pickles.

    ``joints`` and ``parents`` are the skeleton's (-1 for the root); ``times`` are in seconds.
    """
    arrays: dict[str, NDArray[Any]] = {
        **dict(zip(PEOPLE, table.people, strict=False)),
        "times": table.times,
        "fps": np.array(table.fps),
        "joints": np.array(table.skeleton.joints),
        "parents": np.array(table.skeleton.parents),
        "up": np.array(table.up),
        "unit": np.array(table.unit),
    }
    written = io.BytesIO()
    np.savez_compressed(written, allow_pickle=False, **arrays)
    return written.getvalue()


def csv_table(table: JointTable) -> bytes:
    """Write facts as lines ``# name: text``, then one row per frame with a header.

    The columns are ``frame``, ``time`` in seconds, ``person_a.JOINT.x`` and so on. Nine digits
    preserve every float32.
    """
    columns = _columns(table)
    text = io.StringIO()
    text.writelines(f"# {name}: {fact}\n" for name, fact in _facts(table).items())
    csv.writer(text, lineterminator="\n").writerow(["frame", *columns])
    times, *values = columns.values()
    rows = zip(times.tolist(), np.stack(values, axis=1).tolist(), strict=True)
    text.writelines(
        f"{frame},{time:.9f}," + ",".join(f"{value:.9g}" for value in row) + "\n"
        for frame, (time, row) in enumerate(rows)
    )
    return text.getvalue().encode()


def parquet_table(table: JointTable) -> bytes:
    """Write the columns of ``csv_table``, with the facts as metadata of the file."""
    frames = {"frame": np.arange(len(table.times), dtype=np.int32)}
    return parquet_bytes(_facts(table), {**frames, **_columns(table)})


TABLE_WRITERS: dict[str, Callable[[JointTable], bytes]] = {
    ".npz": npz_table,
    ".csv": csv_table,
    ".parquet": parquet_table,
}


def _facts(table: JointTable) -> dict[str, str]:
    return {
        "fps": f"{table.fps:.9g}",
        "unit": f"{table.unit:.17g}",
        "up": table.up,
        "parents": " ".join(map(str, table.skeleton.parents)),
    }


def _columns(table: JointTable) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {TIME: table.times}
    for name, motion in zip(PEOPLE, table.people, strict=False):
        for joint, positions in zip(table.skeleton.joints, motion.swapaxes(0, 1), strict=True):
            for axis, values in zip(AXES, positions.T, strict=True):
                columns[f"{name}.{joint}.{axis}"] = values
    return columns
