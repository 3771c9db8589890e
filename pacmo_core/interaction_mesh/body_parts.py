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


def trunk_pairs(scene: Scene) -> Indices:
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


RIGID, SPINE, NECK = "rigid", "spine", "neck"  # pairs of bones of a trunk that meet


def trunk_bends(scene: Scene) -> tuple[Indices, NDArray[np.str_]]:
    """Return the pairs of bones whose angle a trunk allows little or no change, ``(S, 2)``.

    Those of necks are last. The second value, ``(S,)``, is the kind of each pair:

    - ``rigid``: bones from one joint to a limb and to another joint of the trunk, in a pelvis or a
      chest;
    - ``spine``: bones that follow each other from the root to the arms;
    - ``neck``: bones that follow each other from the joint at which a spine ends, away from all
      limbs.
    """
    pairs, starts = trunk_pairs(scene), scene.bones[:, 0]
    first, second = pairs.T
    leads_to_limb, carries_arms = _carried(scene)
    is_beside = starts[first] == starts[second]
    is_rigid = is_beside & (leads_to_limb[first] | leads_to_limb[second])
    is_spine = ~is_beside & carries_arms[first] & leads_to_limb[second]
    leads_away = ~is_beside & ~leads_to_limb[second]
    neck = np.zeros(len(starts), dtype=np.bool_)
    for _ in starts:  # one bone further each time
        neck[second[leads_away & (carries_arms | neck)[first]]] = True
    is_neck = leads_away & neck[second]
    of_kinds = {RIGID: is_rigid, SPINE: is_spine, NECK: is_neck}
    named = np.select(list(of_kinds.values()), list(of_kinds), default="")
    kept = np.flatnonzero(named)
    kept = np.concatenate([kept[named[kept] != NECK], kept[named[kept] == NECK]])
    return pairs[kept], named[kept]


def _carried(scene: Scene) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """``(E,)`` each: whether a bone leads from the root to a limb, and to both arms."""
    kinds, ancestors = np.array(scene_bone_kinds(scene)), ancestor_bones(scene)
    n_first = scene.n_bones[0]
    leads_to_limb, carries_arms = np.zeros((2, len(kinds)), dtype=np.bool_)
    for kind in _UPPER_LIMBS:
        for own in (slice(None, n_first), slice(n_first, None)):
            joints = scene.bones[own][kinds[own] == kind, 0]
            paths = ancestors[joints] > 0
            leads_to_limb |= paths.any(axis=0)
            if kind == "upper_arm" and len(joints):
                carries_arms |= paths.all(axis=0)
    return leads_to_limb, carries_arms


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
