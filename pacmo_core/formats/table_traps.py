"""Arrays that are no table of joints yet: parents counted from 1, coordinates in another layout.

Such arrays, as programs like MATLAB hold them, have the right shape and would be read as people of
other limbs. They are refused in a line that says what to do.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.posture import UNIT_WORDS, infer_unit, measure_posture
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.base import FormatError

# Measured on captures of six rigs, bodies have an asymmetry up to 0.04 and a longest bone of 2.7 to
# 3.5; in the other layout 0.66 to 1.66, or a longest bone of 1.1 to 1.7. Those of SBU have 0.04 and
# 1.4 to 2.4, and 0.01 and 1.7 or more in the other layout.
_MAX_ASYMMETRY = 0.1  # median of |log(left / right)| over the limbs
_LONGEST = 1.8, 6.0  # of the bones, in median bones
_MIN_LIMBS = 3  # pairs of bones that are mirror images
_N_FRAMES = 200  # of a motion, whose bones are measured
_LAYOUTS = {
    "x y z of joint after joint": "reshape(T, J, 3)",
    "all x, all y, all z": "reshape(T, 3, J).transpose(0, 2, 1)",
}


def parents_hint(joints: Sequence[str], parents: Sequence[int]) -> str:
    """Say what to do with parents that form no tree but would; empty where nothing would."""
    roots = [joint for joint, parent in enumerate(parents) if parent == joint]
    counted = [-1 if parent in (0, -1) else parent - 1 for parent in parents]
    own = [-1 if joint in roots else parent for joint, parent in enumerate(parents)]
    if _is_tree(joints, counted):
        return "; they are counted from 1, as in MATLAB: wanted parents - 1, and -1 for the root"
    if len(roots) == 1 and _is_tree(joints, own):
        return f"; {joints[roots[0]]!r} is its own parent: wanted -1 for the root"
    return ""


def _is_tree(joints: Sequence[str], parents: Sequence[int]) -> bool:
    try:
        Skeleton("tree", tuple(joints), tuple(parents))
    except ValueError:
        return False
    return True


def check_layout(file: Path, name: str, positions: NDArray[np.float64], skeleton: Skeleton) -> None:
    """Refuse positions whose bones are those of no body, but would be in another layout.

    Parameters
    ----------
    name : of the array
    positions : (T, J, 3), any unit

    Raises
    ------
    FormatError
        With the layout in which they are.
    """
    n_frames, n_joints, _ = positions.shape
    some = positions[:: max(1, n_frames // _N_FRAMES)]
    if not n_frames or len(skeleton.mirrored_bones) < _MIN_LIMBS:
        return
    given = _bones(some, skeleton)
    if _is_body(*given):
        return
    others = (
        some.transpose(0, 2, 1).reshape(some.shape),
        some.reshape(-1, 3, n_joints).transpose(0, 2, 1),
    )
    for (layout, code), other in zip(_LAYOUTS.items(), others, strict=True):
        found = _bones(other, skeleton)
        # By chance the bones of a noisy capture are a body's in another layout, but less alike.
        if _is_body(*found) and found[0] < given[0] / 2:
            raise FormatError(
                file,
                f"{name}: bones of no body, but of one if the coordinates of a frame are {layout}: "
                f"wanted array.{code}",
            )


def _is_body(asymmetry: float, longest: float) -> bool:
    return asymmetry <= _MAX_ASYMMETRY and _LONGEST[0] <= longest <= _LONGEST[1]


def _bones(positions: NDArray[np.float64], skeleton: Skeleton) -> tuple[float, float]:
    """Return how unlike left and right limbs are, and the longest bone in median bones."""
    parent, child = skeleton.bones.T
    lengths = np.median(np.linalg.norm(positions[:, child] - positions[:, parent], axis=-1), axis=0)
    left, right = lengths[skeleton.mirrored_bones].T
    measured = (left > 0) & (right > 0)
    if not measured.any():
        return np.inf, np.inf
    asymmetry = float(np.median(np.abs(np.log(left[measured] / right[measured]))))
    return asymmetry, float(lengths.max() / np.median(lengths[lengths > 0]))


def unit_of_word(file: Path, word: str) -> float:
    """Return the metres of a unit by its name.

    Raises
    ------
    FormatError
        If there is none of that name.
    """
    if word.strip().lower() not in UNIT_WORDS:
        wanted = ", ".join(UNIT_WORDS)
        raise FormatError(file, f"unit: wanted metres per unit, or {wanted}; got {word[:40]!r}")
    return UNIT_WORDS[word.strip().lower()]


def unit_hint(positions: NDArray[np.float64], skeleton: Skeleton) -> str:
    """Say which unit would give a person of a usual stature; empty where no body is recognised."""
    posture = measure_posture(positions, skeleton)
    unit = None if posture is None else infer_unit(posture)
    if posture is None or unit is None:
        return ""
    return f"; unit {unit:g} would make a person of {unit * posture.stature:.2f} m"
