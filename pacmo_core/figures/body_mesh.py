"""The body as one skin mesh in the rest pose, each vertex bound to one joint."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.body_shape import BodyShape
from pacmo_core.formats.write_gltf import Skin

_ROWS, _COLUMNS = 5, 14
Array = NDArray[np.float64]
Sphere = tuple[Array, float, int]  # centre, radius, the joint that it is bound to


def make_skin(body: BodyShape, skeleton: Skeleton, rest: Array) -> Skin:
    """Build the mesh.

    A limb is bound to the joint at which it starts, whose rotation moves its other end. A corner
    of the trunk is bound to the parent of its joint: a shoulder must not rotate with the arm.

    Parameters
    ----------
    rest : (J, 3) metres, joints in the rest pose
    """
    parts = [_limb(rest, limb) for limb in body.limbs if np.ptp(rest[list(limb[:2])], axis=0).any()]
    if body.trunk:
        above = [skeleton.parents[j] if j != skeleton.root else j for j, _ in body.trunk]
        spheres = [(rest[j], r, p) for (j, r), p in zip(body.trunk, above, strict=True)]
        left = rest[body.trunk[0][0]] - rest[body.trunk[1][0]]
        spine = (rest[[j for j, _ in body.trunk[:2]]] - rest[[j for j, _ in body.trunk[2:]]]).sum(0)
        front = np.cross(left, spine)
        if front.any():  # not where a rig rests with all of the trunk on one line
            parts.append(_hull(spheres, _axes(left, front)))
    if body.head:
        centre = rest[list(body.head)].mean(axis=0)
        parts.append(_hull([(centre, body.head_radius, body.head[0])], np.eye(3)))
    if not parts:
        parts = [_hull([(position, 0.05, joint)], np.eye(3)) for joint, position in enumerate(rest)]
    return _concatenate_skins(parts)


def _limb(rest: Array, limb: tuple[int, int, float, float]) -> Skin:
    parent, child, thick, thin = limb
    along = rest[child] - rest[parent]
    aside = np.eye(3)[np.abs(along).argmin()]
    spheres = [(rest[child], thin, parent), (rest[parent], thick, parent)]
    across = np.cross(along, aside)
    return _hull(spheres, _axes(across, np.cross(across, along)))


def _axes(x: Array, z: Array) -> Array:
    """Return the unit vectors x, y, z as rows, from orthogonal x and z."""
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _hull(spheres: Sequence[Sphere], axes: Array) -> Skin:
    """Return the hull of one, two (above, below) or four spheres (above and below, left first)."""
    count = len(spheres)
    half = np.pi / 2
    below = [(a, count // 2) for a in np.linspace(-half, 0, _ROWS + 1)]
    above = [(a, 0) for a in np.linspace(0, half, _ROWS + 1)]
    rows = [*below, *(above if count > 1 else above[1:])]
    left = [(a, 0) for a in np.linspace(-half, half, _COLUMNS // 2 + 1)]
    right = [(a, 1) for a in np.linspace(half, 3 * half, _COLUMNS // 2 + 1)]
    around = [(a, 0) for a in np.linspace(0, 4 * half, _COLUMNS + 1)]
    columns = [*left, *right, (-half, 0)] if count == 4 else around
    lat = np.array([a for a, _ in rows])[:, None]
    lon = np.array([a for a, _ in columns])[None]
    normals = np.stack(
        np.broadcast_arrays(np.cos(lat) * np.cos(lon), np.sin(lat), -np.cos(lat) * np.sin(lon)), -1
    )
    which = np.array([d for _, d in rows])[:, None] + np.array([s for _, s in columns])[None]
    rotated = normals.reshape(-1, 3) @ axes
    centres, radii, joints = (np.array(values) for values in zip(*spheres, strict=True))
    flat = which.reshape(-1)
    positions = centres[flat] + rotated * radii[flat][:, None]
    return Skin(
        positions.astype(np.float32),
        rotated.astype(np.float32),
        joints[flat],
        _faces(len(rows), len(columns)),
    )


def _faces(rows: int, columns: int) -> NDArray[np.intp]:
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)[None]).reshape(-1)
    b = a + columns
    return np.concatenate([np.stack([a, a + 1, b], 1), np.stack([b, a + 1, b + 1], 1)])


def _concatenate_skins(parts: Sequence[Skin]) -> Skin:
    starts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    return Skin(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.joints for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
    )
