"""Motions as tables: CSV for spreadsheets, NPZ for NumPy."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton

PERSONS = ("a", "b")


def format_csv(skeleton: Skeleton, times: NDArray[np.float64], people: Sequence[Motion]) -> str:
    """Write one row per frame: ``frame``, ``time`` in seconds, ``a.JOINT.x`` and so on.

    Nine digits preserve every float32. Names of joints with a comma or a quotation mark are
    quoted.

    Parameters
    ----------
    people : one or two of (T, J, 3) float32, in any unit
    """
    names = [
        _quoted(f"{person}.{joint}.{axis}")
        for person in PERSONS[: len(people)]
        for joint in skeleton.joints
        for axis in "xyz"
    ]
    values = np.concatenate([motion.reshape(len(times), -1) for motion in people], axis=1)
    rows = [
        f"{frame},{time:.9f}," + ",".join(f"{value:.9g}" for value in row)
        for frame, (time, row) in enumerate(zip(times.tolist(), values.tolist(), strict=True))
    ]
    return "\n".join([",".join(["frame", "time", *names]), *rows]) + "\n"


def npz_bytes(
    skeleton: Skeleton,
    times: NDArray[np.float64],
    people: Sequence[Motion],
    *,
    up: str,
    unit: float,
) -> bytes:
    """Write ``person_a``, ``person_b`` (T, J, 3) float32, ``times``, and their description.

    ``joints`` and ``parents`` are the skeleton's (-1 for the root), ``up`` the upward axis and
    ``unit`` metres a unit. No entry needs pickle to be read.
    """
    arrays: dict[str, NDArray[Any]] = {
        **{f"person_{person}": m for person, m in zip(PERSONS, people, strict=False)},
        "times": times,
        "joints": np.array(skeleton.joints),
        "parents": np.array(skeleton.parents),
        "up": np.array(up),
        "unit": np.array(unit),
    }
    written = io.BytesIO()
    np.savez_compressed(written, allow_pickle=False, **arrays)
    return written.getvalue()


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n\r') else name
