"""The radii of head, trunk and limbs as solids, by the names of the joints."""

import re
from dataclasses import dataclass

from pacmo_core.data.skeleton import OBJECT, Skeleton, bare_names

# Radius of the body at a joint, metres, of an adult; the first matching pattern applies.
_RADII = (
    (r"head|skull", 0.105),
    (r"tip|thumb|finger|index|ring|pinky", 0.016),
    (r"toe", 0.030),
    (r"ankle|foot|heel", 0.040),
    (r"knee|shin|(left|right|^[lr])_?(low)?leg", 0.056),
    (r"hand", 0.037),
    (r"wrist", 0.033),
    (r"elbow|forearm", 0.041),
    (r"collar|clavicle", 0.050),
    (r"shoulder|arm", 0.052),
    (r"neck", 0.050),
    (r"(left|right|^[lr])_?(hip|up_?leg|thigh)", 0.080),
    (r"hip|pelvis|root|spine|torso|back|chest", 0.090),
)
_UNNAMED_RADIUS = 0.045
_HEAD, _HEAD_RADIUS = _RADII[0]
_ELBOW = _RADII[7][0]
_KNEE = _RADII[4][0]
_MIDDLE = re.compile(r"^hips?$|pelvis|root|spine|torso|back|chest|neck")
_SHOULDER_RADIUS, _HIP_RADIUS = 0.070, 0.092
OBJECT_RADIUS = 0.06  # metres, of a thing whose size is not known


@dataclass(frozen=True)
class BodyShape:
    """The solids of the body of one skeleton, as joint indices and radii in metres.

    Parameters
    ----------
    head : joints whose mean is the centre of the head: those of that name, else the ends of the
        neck; empty if no joint is one
    head_radius : metres
    trunk : (joint, radius) of the spheres whose hull is the trunk; empty if it is unknown
    limbs : (parent, child, radius at the parent, radius at the child); a thing that is held is one
        of no length
    """

    head: tuple[int, ...]
    head_radius: float
    trunk: tuple[tuple[int, float], ...]
    limbs: tuple[tuple[int, int, float, float], ...]


def make_body_shape(skeleton: Skeleton) -> BodyShape:
    """Return a sphere for the head, a hull for the trunk and tapered capsules for the limbs.

    A skeleton without names of elbows and knees gets one capsule per bone.
    """
    names = [joint.lower() for joint in bare_names(skeleton.joints)]
    named = tuple(i for i, name in enumerate(names) if re.search(_HEAD, name))
    head = named or tuple(i for i in skeleton.end_effectors if "neck" in names[i])
    trunk = _trunk(skeleton, names)
    inside = {joint for joint, _ in trunk} | {
        i for i, name in enumerate(names) if trunk and i not in head and _MIDDLE.search(name)
    }
    limbs = tuple(
        (parent, child, *_limb_radii(names[parent], names[child]))
        for parent, child in skeleton.body_bones.tolist()
        if not (parent in head and child in head) and not {parent, child} <= inside
    )
    things = tuple((i, i, OBJECT_RADIUS, OBJECT_RADIUS) for i in objects(skeleton))
    return BodyShape(head, _HEAD_RADIUS if head else 0.0, trunk, limbs + things)


def objects(skeleton: Skeleton) -> list[int]:
    """List the joint that is a thing and no part of the body, if there is one."""
    return [i for i, joint in enumerate(skeleton.joints) if joint == OBJECT]


def _radius(name: str) -> float:
    return next((r for pattern, r in _RADII if re.search(pattern, name)), _UNNAMED_RADIUS)


def _limb_radii(parent: str, child: str) -> tuple[float, float]:
    """Return the radii at both ends; at the trunk a limb has the radius of its other end."""
    if _MIDDLE.search(parent) or re.search(_HEAD, parent + child):
        thin = min(_radius(parent), _radius(child), 0.052)
        return thin, thin
    return _radius(parent), _radius(child)


def _trunk(skeleton: Skeleton, names: list[str]) -> tuple[tuple[int, float], ...]:
    """Return the parents of both elbows and of both knees."""
    corners = [
        (skeleton.parents[joint], radius)
        for pattern, radius in ((_ELBOW, _SHOULDER_RADIUS), (_KNEE, _HIP_RADIUS))
        for pair in skeleton.left_right
        if all(re.search(pattern, names[i]) for i in pair)
        for joint in pair
    ]
    return tuple(corners) if len({joint for joint, _ in corners}) == len(corners) == 4 else ()
