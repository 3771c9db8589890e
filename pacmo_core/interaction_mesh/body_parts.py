"""What the joints and bones of a scene are on the body: trunk, limbs, hinges, hands, capsules.

The parts come from the topology and the names of each skeleton (``data.segments``).
"""

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.interaction_mesh.scene import Array, Scene
from pacmo_core.interaction_mesh.settings import Posture

Indices = NDArray[np.intp]

# Radius of the capsule around a bone, as a fraction of the person's leg length (thigh and shin),
# by kind of segment; read off adults of average build (leg 0.86 m): 4.5 cm is a forearm's radius.
CAPSULE_RADII = {
    "thigh": 0.085,
    "shin": 0.055,
    "foot": 0.04,
    "upper_arm": 0.05,
    "forearm": 0.04,
    "trunk": 0.11,
    "head": 0.095,
    "neck": 0.06,
}
HAND_RADIUS = 0.025
# Bones of the trunk that run sideways, to a hip or a shoulder, lie within the trunk.
SIDEWAYS_RADIUS = 0.06


@lru_cache(maxsize=8)
def bone_kinds(skeleton: Skeleton) -> tuple[str, ...]:
    """Return the kind of every bone: trunk, thigh, shin, foot, upper_arm, forearm or hand."""
    kinds = []
    for segment in segments(skeleton):
        if segment.part in ("trunk", "foot"):
            kinds.append(segment.part)
        elif segment.kind in ("thigh", "shin", "upper_arm", "forearm"):
            kinds.append(segment.kind)
        else:
            kinds.append("hand")
    return tuple(kinds)


def scene_bone_kinds(scene: Scene) -> list[str]:
    """Return ``bone_kinds`` of both people, in the order of ``scene.bones``."""
    return [kind for skeleton in scene.skeletons for kind in bone_kinds(skeleton)]


def posture_weights(scene: Scene, posture: Posture) -> Array:
    """``(E,)``: weight on the direction of each bone."""
    weights = {
        "trunk": posture.trunk,
        "thigh": posture.upper_limb,
        "upper_arm": posture.upper_limb,
        "shin": posture.shin,
        "foot": posture.foot,
        "forearm": posture.forearm,
        "hand": posture.forearm,
    }
    return np.array([weights[kind] for kind in scene_bone_kinds(scene)])


def is_hand(scene: Scene) -> NDArray[np.bool_]:
    """``(N,)``: whether a joint is a wrist or beyond it."""
    result = np.zeros(sum(scene.n_joints), dtype=np.bool_)
    for (_, child), kind in zip(scene.bones.tolist(), scene_bone_kinds(scene), strict=True):
        result[child] = kind in ("forearm", "hand")
    return result


def hinges(scene: Scene) -> tuple[Indices, list[str]]:
    """Return the two bones (upper, lower) of every knee and elbow, ``(H, 2)``, and its name."""
    pairs, names = [], []
    kinds, bones = scene_bone_kinds(scene), scene.bones.tolist()
    for lower, (joint, _) in enumerate(bones):
        name = {"shin": "knee", "forearm": "elbow"}.get(kinds[lower])
        above = [row for row, (_, child) in enumerate(bones) if child == joint]
        if name and above and kinds[above[0]] in ("thigh", "upper_arm"):
            pairs.append((above[0], lower))
            names.append(name)
    return np.array(pairs, dtype=np.intp).reshape(-1, 2), names


def spine_bends(scene: Scene) -> Indices:
    """``(S, 2)``: pairs of bones of a trunk that meet at a joint."""
    kinds, bones = scene_bone_kinds(scene), scene.bones.tolist()
    trunk = [row for row, kind in enumerate(kinds) if kind == "trunk"]
    pairs = [
        (first, second)
        for first in trunk
        for second in trunk
        if bones[first][1] == bones[second][0]
        or (first < second and bones[first][0] == bones[second][0])
    ]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def trunk_bends(scene: Scene) -> tuple[Indices, NDArray[np.bool_]]:
    """Return the pairs of bones whose angle a trunk allows little or no change, ``(S, 2)``.

    Bones from one joint to a limb and to another joint of the trunk are one rigid part, the pelvis
    or the chest: the second value, ``(S,)``, is true. The others follow each other from the root to
    the arms: joints of the spine.
    """
    bends, ancestors = spine_bends(scene), ancestor_bones(scene)
    leads_to_limb, spine = np.zeros((2, len(scene.bones)), dtype=np.bool_)
    for kind in _UPPER_LIMBS:
        for person in (0, 1):
            limbs = [
                row for row in _bones_of(scene, person) if scene_bone_kinds(scene)[row] == kind
            ]
            paths = ancestors[scene.bones[limbs, 0]] > 0
            leads_to_limb |= paths.any(axis=0)
            if kind == "upper_arm" and limbs:
                spine |= paths.all(axis=0)
    first, second = bends.T
    is_rigid = scene.bones[first, 0] == scene.bones[second, 0]
    kept = np.where(is_rigid, leads_to_limb[first] | leads_to_limb[second], spine[first])
    kept &= is_rigid | leads_to_limb[second]
    return bends[kept], is_rigid[kept]


def neck_bends(scene: Scene) -> Indices:
    """``(S, 2)``: pairs of bones of necks that follow each other, the first beyond the arms.

    A neck leads from the joint at which a spine ends away from all limbs.
    """
    bends, ancestors = spine_bends(scene), ancestor_bones(scene)
    carries = np.zeros((2, len(scene.bones)), dtype=np.bool_)  # a limb; both arms
    for person in (0, 1):
        rows = _bones_of(scene, person)
        for kind in _UPPER_LIMBS:
            limbs = [row for row in rows if scene_bone_kinds(scene)[row] == kind]
            paths = ancestors[scene.bones[limbs, 0]] > 0
            carries[0] |= paths.any(axis=0)
            carries[1] |= paths.all(axis=0) & (kind == "upper_arm" and len(limbs) > 0)
    first, second = bends.T
    follows = (scene.bones[first, 1] == scene.bones[second, 0]) & ~carries[0][second]
    neck = np.zeros(len(scene.bones), dtype=np.bool_)
    for _ in scene.bones:
        neck[second[follows & (carries[1] | neck)[first]]] = True
    found: Indices = bends[follows & neck[second]]
    return found


def _bones_of(scene: Scene, person: int) -> list[int]:
    n_a = scene.n_joints[0]
    return [row for row, (joint, _) in enumerate(scene.bones) if (joint >= n_a) == bool(person)]


def bone_to_joint(scene: Scene) -> dict[int, int]:
    """Return the bone that ends at each joint but the roots."""
    return {child: row for row, (_, child) in enumerate(scene.bones.tolist())}


def ancestor_bones(scene: Scene) -> Array:
    """``(N, E)``: ones where a bone lies between a point and its body's root."""
    bone_of = bone_to_joint(scene)
    ancestors = np.zeros((scene.points.shape[1], len(scene.bones)))
    for point in range(len(ancestors)):
        joint = point
        while joint in bone_of:
            bone = bone_of[joint]
            ancestors[point, bone] = 1
            joint = int(scene.bones[bone, 0])
    return ancestors


def trunk_joints(scene: Scene) -> list[Indices]:
    """List the points of each body's trunk: hips, shoulders and what connects them.

    A body without named limbs has no trunk.
    """
    limbs = [row for row, kind in enumerate(scene_bone_kinds(scene)) if kind in _UPPER_LIMBS]
    ancestors = ancestor_bones(scene)
    trunks: tuple[set[int], set[int]] = (set(), set())
    for row in limbs:
        joint = int(scene.bones[row, 0])
        person = int(joint >= scene.n_joints[0])
        trunks[person].add(joint)
        trunks[person].update(scene.bones[np.flatnonzero(ancestors[joint]), 0].tolist())
    return [np.array(sorted(trunk), dtype=np.intp) for trunk in trunks]


_UPPER_LIMBS = ("thigh", "upper_arm")


def capsule_radii(scene: Scene) -> Array:
    """``(E,)`` metres: radius of the capsule around each bone."""
    lengths = np.linalg.norm(scene.bone_vectors, axis=-1).mean(axis=0)
    radii, first = [], 0
    for skeleton in scene.skeletons:
        body = lengths[first : first + len(skeleton.bones)]
        leg = _leg_length(bone_kinds(skeleton), body)
        radii += [leg * fraction for fraction in _radius_fractions(skeleton)]
        first += len(body)
    return np.array(radii)


def _leg_length(kinds: Iterable[str], lengths: Array) -> float:
    """Return the length of thigh and shin; without legs, half of the sum of all bones' mean."""
    kinds = list(kinds)
    parts = [lengths[[k == kind for k in kinds]] for kind in ("thigh", "shin")]
    if all(len(part) for part in parts):
        return float(sum(part.mean() for part in parts))
    return float(4 * lengths.mean())


def _radius_fractions(skeleton: Skeleton) -> list[float]:
    ends = {joint for pair in skeleton.left_right for joint in pair}
    fractions = []
    named = zip(
        skeleton.bones[:, 1].tolist(), bone_kinds(skeleton), segments(skeleton), strict=True
    )
    for child, kind, segment in named:
        if kind == "hand":
            fractions.append(HAND_RADIUS)
        elif kind == "trunk" and child in ends:
            fractions.append(SIDEWAYS_RADIUS)
        else:
            words = set(segment.name.split("_"))
            key = "head" if "head" in words else "neck" if "neck" in segment.name else kind
            fractions.append(CAPSULE_RADII[key])
    return fractions
