"""The pose of a tree of stiff joints that comes nearest to places that were wanted.

Bones that leave one joint keep their angles to each other in files of rotations, so that not every
pose can be met; what is missed is spread over the body, instead of handed down to its ends.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Weight of keeping a joint's own rotation beside bones of unit length squared: decides only what
# the bones leave open.
STAY = 1e-6
ROUNDS = 6
DAMPING = 1e-3  # of a turn, beside the squared size of the body that it moves
FRAMES = 128  # at a time: what stands in memory


def forward(parents: Sequence[int], root: Array, moved: Array, local: Array) -> tuple[Array, Array]:
    """Give every joint's place (T, J, 3) and its axes in the world (T, J, 3, 3).

    Parameters
    ----------
    parents : each before its children
    root : (T, 3)
    moved : (T, J, 3) from the parent, in the parent's frame
    local : (T, J, 3, 3), rotations against the parent
    """
    places, turns = np.zeros_like(moved), np.zeros_like(local)
    places[:, 0], turns[:, 0] = root, local[:, 0]
    for joint, parent in enumerate(parents):
        if parent >= 0:
            places[:, joint] = places[:, parent] + turned(turns[:, parent], moved[:, joint])
            turns[:, joint] = turns[:, parent] @ local[:, joint]
    return places, turns


def aimed(
    parents: Sequence[int], wanted: dict[int, Array], moved: Array, local: Array
) -> tuple[Array, Array]:
    """Turn joints from the root on so that their bones point to where they should (Kabsch).

    Parameters
    ----------
    wanted : (T, 3) places of some joints, the root among them
    local : (T, J, 3, 3), from which what the bones leave open is taken

    Returns
    -------
    root : (T, 3)
    local : (T, J, 3, 3)
    """
    places, turns, found = np.zeros_like(moved), np.zeros_like(local), np.zeros_like(local)
    for joint, parent in enumerate(parents):
        above = turns[:, parent] if parent >= 0 else np.eye(3)[None]
        base = wanted[joint] if parent < 0 else places[:, parent]
        places[:, joint] = base + (turned(above, moved[:, joint]) if parent >= 0 else 0)
        ends = [c for c, p in enumerate(parents) if p == joint and c in wanted]
        targets = [wanted[child] - places[:, joint] for child in ends]
        turns[:, joint] = _nearest(targets, [moved[:, c] for c in ends], above @ local[:, joint])
        found[:, joint] = np.swapaxes(above, -1, -2) @ turns[:, joint]
    return wanted[0], found


def settled(
    parents: Sequence[int], wanted: dict[int, Array], moved: Array, guess: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Spread what a guess misses over the body: least squares by Gauss and Newton, damped.

    Parameters
    ----------
    guess : root and local rotations, as ``aimed`` gives them
    """
    root, local = guess[0].copy(), guess[1].copy()
    for first in range(0, len(root), FRAMES):
        part = slice(first, first + FRAMES)
        own = {joint: places[part] for joint, places in wanted.items()}
        for _ in range(ROUNDS):
            _step(parents, own, moved[part], (root[part], local[part]))
    return root, local


def turned(frames: Array, vectors: Array) -> Array:
    """``(T, 3)``: vectors given in frames, in the world."""
    found: Array = (frames @ vectors[..., None])[..., 0]
    return found


def _step(
    parents: Sequence[int], wanted: dict[int, Array], moved: Array, pose: tuple[Array, Array]
) -> None:
    """Move a pose, in place, to the least of the squares about it."""
    root, local = pose
    places, turns = forward(parents, root, moved, local)
    inner = sorted(set(parents) - {-1})
    rows = list(wanted)
    slopes = _slopes(parents, places, inner, rows)
    missed = np.stack([wanted[joint] - places[:, joint] for joint in rows], axis=1)
    square = slopes.swapaxes(1, 2) @ slopes
    size = np.square(places - places.mean(axis=1, keepdims=True)).sum(axis=-1).mean(axis=1)
    damping = np.concatenate([np.zeros(3), np.full(3 * len(inner), DAMPING)])
    square += np.eye(len(damping)) * (damping * size[:, None])[:, None]
    pull = slopes.swapaxes(1, 2) @ missed.reshape(len(root), -1, 1)
    found: Array = np.linalg.solve(square, pull)[..., 0].astype(np.float64)
    root += found[:, :3]
    for place, joint in enumerate(inner):
        turn = _rotation(found[:, 3 + 3 * place : 6 + 3 * place])
        above = turns[:, parents[joint]] if parents[joint] >= 0 else np.eye(3)[None]
        local[:, joint] = np.swapaxes(above, -1, -2) @ turn @ above @ local[:, joint]


def _slopes(parents: Sequence[int], places: Array, inner: list[int], rows: list[int]) -> Array:
    """``(T, 3 K, 3 + 3 I)``: how places change with the root and with turns of inner joints."""
    slopes = np.zeros((len(places), len(rows), 3, 1 + len(inner), 3))
    slopes[..., 0, :] = np.eye(3)
    for row, joint in enumerate(rows):
        above = parents[joint]
        while above >= 0:
            slopes[:, row, :, 1 + inner.index(above)] = -_cross(places[:, joint] - places[:, above])
            above = parents[above]
    return slopes.reshape(len(places), 3 * len(rows), -1)


def _cross(vectors: Array) -> Array:
    """``(T, 3, 3)``: the matrix that multiplies by a vector's cross product."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    return np.array([[none, -z, y], [z, none, -x], [-y, x, none]]).transpose(2, 0, 1)


def _rotation(vectors: Array) -> Array:
    """``(T, 3, 3)``: the turn about each vector by its length in radians (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None]
    cross = _cross(vectors / np.maximum(angle[:, 0], np.finfo(np.float64).tiny))
    turns: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    return turns


def _nearest(targets: list[Array], bones: list[Array], stay: Array) -> Array:
    """``(T, 3, 3)``: the rotation that takes bones nearest to targets, else as it was."""
    if not bones:
        return stay
    wanted, offsets = np.stack(targets, axis=1), np.stack(bones, axis=1)
    size = np.maximum(np.square(offsets).sum(axis=(1, 2)), np.finfo(np.float64).tiny)
    together = np.einsum("tni,tnj->tij", wanted, offsets) / size[:, None, None]
    left, _, right = np.linalg.svd(together + STAY * stay)
    left[..., -1] *= np.linalg.det(left @ right)[:, None]
    nearest: Array = left @ right
    return nearest
