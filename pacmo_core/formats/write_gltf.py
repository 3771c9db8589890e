"""Motions as glTF 2.0: an animated skeleton and a skin a person, metres, y up.

The standard is the Khronos Group's glTF 2.0 (ISO/IEC 12113:2022): quaternions are x, y, z, w; a
skin's vertices go with their joints' nodes; matrices are stored column by column.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.fit_bones import Fitted
from pacmo_core.formats.gltf_buffer import INDICES, VERTICES, Buffer


@dataclass(frozen=True)
class Skin:
    """A mesh in the pose of rest: every joint unturned, the root at the origin.

    Parameters
    ----------
    places, normals : (V, 3) float32, metres
    joints : (V,) the joint with which a vertex goes
    faces : (F, 3) vertices, counter-clockwise from outside
    """

    places: NDArray[np.float32]
    normals: NDArray[np.float32]
    joints: NDArray[np.intp]
    faces: NDArray[np.intp]


@dataclass(frozen=True)
class Actor:
    """One person to be written.

    Parameters
    ----------
    name : goes before the names of joints
    fitted : the motion, of constant bones
    skin : what is seen
    colour : red, green, blue, linear, 0 to 1
    """

    name: str
    fitted: Fitted
    skin: Skin
    colour: tuple[float, float, float]


def rest_places(fitted: Fitted, skeleton: Skeleton) -> NDArray[np.float64]:
    """``(J, 3)`` metres: where joints are when none is turned and the root is at the origin."""
    places = np.zeros_like(fitted.offsets)
    for joint in skeleton.order:
        if joint != skeleton.root:
            places[joint] = places[skeleton.parents[joint]] + fitted.offsets[joint]
    return places


def gltf_document(
    skeleton: Skeleton, times: NDArray[np.float64], actors: Sequence[Actor]
) -> tuple[dict[str, Any], bytes]:
    """Describe people in motion: the document, without its buffer, and the buffer's data.

    Parameters
    ----------
    times : (T,) float64, seconds, of every actor's frames; the first becomes zero
    """
    buffer = Buffer()
    clock = buffer.add((times - times[0]).astype(np.float32), bounds=True)
    width = len(skeleton.joints)
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "pacmo"},
        "scene": 0,
        "scenes": [{"nodes": []}],
        "nodes": [],
        "meshes": [],
        "skins": [],
        "materials": [],
        "animations": [{"name": "motion", "channels": [], "samplers": []}],
    }
    for number, actor in enumerate(actors):
        first = number * (width + 1)
        document["nodes"] += _joint_nodes(actor, skeleton, first)
        document["nodes"].append({"name": actor.name, "mesh": number, "skin": number})
        document["scenes"][0]["nodes"] += [first + skeleton.root, first + width]
        document["meshes"].append(_mesh(actor, buffer, number))
        document["materials"].append(_material(actor))
        document["skins"].append(_bound(actor, skeleton, buffer, first))
        _animate(document["animations"][0], actor, skeleton, buffer, (clock, first))
    document |= {"bufferViews": buffer.views, "accessors": buffer.accessors}
    return document, bytes(buffer.data)


def quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float32]:
    """``(T, 4)`` x, y, z, w of ``(T, 3, 3)`` rotations, without jumps from q to -q."""
    found = Rotation.from_matrix(rotations).as_quat()
    turns = np.where((found[1:] * found[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    found[1:] *= np.cumprod(turns)[:, None]
    return found.astype(np.float32)


def _joint_nodes(actor: Actor, skeleton: Skeleton, first: int) -> list[dict[str, Any]]:
    """Describe the joints, as they stand in the first frame."""
    nodes = []
    for joint, name in enumerate(skeleton.joints):
        at_root = joint == skeleton.root
        place = actor.fitted.root[0] if at_root else actor.fitted.offsets[joint]
        children = [first + c for c, parent in enumerate(skeleton.parents) if parent == joint]
        node: dict[str, Any] = {
            "name": f"{actor.name}_{name}",
            "translation": place.astype(np.float32).tolist(),
            "rotation": quaternions(actor.fitted.rotations[:1, joint])[0].tolist(),
        }
        nodes.append(node | ({"children": children} if children else {}))
    return nodes


def _mesh(actor: Actor, buffer: Buffer, material: int) -> dict[str, Any]:
    skin = actor.skin
    joints = np.zeros((len(skin.joints), 4), np.uint16)
    joints[:, 0] = skin.joints
    weights = np.zeros((len(skin.joints), 4), np.float32)
    weights[:, 0] = 1
    attributes = {
        "POSITION": buffer.add(skin.places, VERTICES, bounds=True),
        "NORMAL": buffer.add(skin.normals, VERTICES),
        "JOINTS_0": buffer.add(joints, VERTICES),
        "WEIGHTS_0": buffer.add(weights, VERTICES),
    }
    indices = buffer.add(skin.faces.astype(np.uint32).reshape(-1), INDICES)
    return {
        "name": actor.name,
        "primitives": [{"attributes": attributes, "indices": indices, "material": material}],
    }


def _material(actor: Actor) -> dict[str, Any]:
    shine = {"baseColorFactor": [*actor.colour, 1.0], "metallicFactor": 0, "roughnessFactor": 0.65}
    return {"name": actor.name, "pbrMetallicRoughness": shine}


def _bound(actor: Actor, skeleton: Skeleton, buffer: Buffer, first: int) -> dict[str, Any]:
    """Tie the mesh to the joints: from the pose of rest to each joint's own frame."""
    back = np.tile(np.eye(4, dtype=np.float32), (len(skeleton.joints), 1, 1))
    back[:, 3, :3] = -rest_places(actor.fitted, skeleton)  # row 3 is column 3 as stored
    return {
        "joints": list(range(first, first + len(skeleton.joints))),
        "inverseBindMatrices": buffer.add(back),
        "skeleton": first + skeleton.root,
    }


def _animate(
    animation: dict[str, Any],
    actor: Actor,
    skeleton: Skeleton,
    buffer: Buffer,
    numbers: tuple[int, int],
) -> None:
    """Add what moves: the root, and the turn of every joint that carries others."""
    clock, first = numbers
    moved = [(skeleton.root, "translation", actor.fitted.root.astype(np.float32))]
    moved += [
        (joint, "rotation", quaternions(actor.fitted.rotations[:, joint]))
        for joint in sorted(set(skeleton.parents) - {-1})
    ]
    for joint, path, values in moved:
        target = {"node": first + joint, "path": path}
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": target})
        animation["samplers"].append({"input": clock, "output": buffer.add(values)})
