"""Motions as glTF 2.0: an animated skeleton and a skin a person, metres, y up.

The standard is the Khronos Group's glTF 2.0 (ISO/IEC 12113:2022): quaternions are x, y, z, w; a
skin's vertices are bound to their joints' nodes; matrices are stored column by column.
"""

import base64
import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.fit_bones import ConstantBoneMotion

_TYPES = {
    np.dtype(np.float32): 5126,
    np.dtype(np.uint32): 5125,
    np.dtype(np.uint16): 5123,
    np.dtype(np.uint8): 5121,
}
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
VERTICES, INDICES = 34962, 34963
_GLB, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942


class BinaryBuffer:
    """The binary buffer: arrays one after another, each with the index of its accessor."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: NDArray[Any], target: int = 0, *, bounds: bool = False) -> int:
        """Append an array ``(N, ...)``; return the index of its accessor.

        Parameters
        ----------
        target : ``VERTICES`` or ``INDICES`` for mesh data
        bounds : state the minimum and maximum, which the standard requires of positions and times
        """
        self.data += b"\0" * (-len(self.data) % 4)
        content = np.ascontiguousarray(array).tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)}
        self.views.append(view | ({"target": target} if target else {}))
        self.data += content
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": _TYPES[array.dtype],
            "count": len(array),
            "type": _SHAPES[array.shape[1:]],
        }
        if bounds:
            flat = array.reshape(len(array), -1)
            accessor |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def to_glb(document: dict[str, Any], data: bytes) -> bytes:
    """Write a document and its data as one binary file (GLB)."""
    text = json.dumps(
        _with_buffer(document, {"byteLength": len(data)}), separators=(",", ":")
    ).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    length = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<III", _GLB, 2, length) + struct.pack("<II", len(text), _JSON)
    return head + text + struct.pack("<II", len(data), _BIN) + data


def to_gltf(document: dict[str, Any], data: bytes) -> bytes:
    """Write a document and its data as one JSON file."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    complete = _with_buffer(document, {"byteLength": len(data), "uri": uri})
    return json.dumps(complete, separators=(",", ":")).encode()


def _with_buffer(document: dict[str, Any], buffer: dict[str, Any]) -> dict[str, Any]:
    return {**document, "buffers": [buffer]}


@dataclass(frozen=True)
class Skin:
    """A mesh in the rest pose: every joint at the identity rotation, the root at the origin.

    Parameters
    ----------
    positions, normals : (V, 3) float32, metres
    joints : (V,) the joint that a vertex is bound to
    faces : (F, 3) vertices, counter-clockwise from outside
    """

    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    joints: NDArray[np.intp]
    faces: NDArray[np.intp]


@dataclass(frozen=True)
class AnimatedPerson:
    """One person to be written.

    Parameters
    ----------
    name : prefix of the joint names, as in ``a_head``; the armature is ``person_a``
    skeleton : of the person
    fitted : the motion, of constant bones
    skin : the mesh
    colour : red, green, blue, linear, 0 to 1
    """

    name: str
    skeleton: Skeleton
    fitted: ConstantBoneMotion
    skin: Skin
    colour: tuple[float, float, float]


def rest_positions(fitted: ConstantBoneMotion, skeleton: Skeleton) -> NDArray[np.float64]:
    """``(J, 3)`` metres: joint positions in the rest pose."""
    positions = np.zeros_like(fitted.offsets)
    for joint in skeleton.order:
        if joint != skeleton.root:
            positions[joint] = positions[skeleton.parents[joint]] + fitted.offsets[joint]
    return positions


def gltf_document(
    times: NDArray[np.float64], people: Sequence[AnimatedPerson]
) -> tuple[dict[str, Any], bytes]:
    """Describe animated people: the document without its buffer, and the buffer's data.

    Parameters
    ----------
    times : (T,) float64, seconds, of every person's frames; the first becomes zero

    Raises
    ------
    ValueError
        If a person has another number of frames.
    """
    for person in people:
        if len(person.fitted.root) != len(times):
            raise ValueError(f"{len(times)} times; got {len(person.fitted.root)} frames")
    buffer = BinaryBuffer()
    clock = buffer.add((times - times[0]).astype(np.float32), bounds=True)
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
    for number, person in enumerate(people):
        first, width = len(document["nodes"]), len(person.skeleton.joints)
        document["nodes"] += _joint_nodes(person, first)
        document["nodes"] += _person_nodes(person, first, number)
        document["scenes"][0]["nodes"] += [first + width, first + width + 1]
        document["meshes"].append(_mesh(person, buffer, number))
        document["materials"].append(_material(person))
        document["skins"].append(_skin(person, buffer, first))
        _animate(document["animations"][0], person, buffer, (clock, first))
    document |= {"bufferViews": buffer.views, "accessors": buffer.accessors}
    return document, bytes(buffer.data)


def quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float32]:
    """``(T, 4)`` x, y, z, w of ``(T, 3, 3)`` rotations, without sign flips."""
    quaternion = Rotation.from_matrix(rotations).as_quat()
    signs = np.where((quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    quaternion[1:] *= np.cumprod(signs)[:, None]
    return quaternion.astype(np.float32)


def _joint_nodes(person: AnimatedPerson, first: int) -> list[dict[str, Any]]:
    """Describe the joints in the rest pose, where the root is in the first frame."""
    nodes = []
    for joint, name in enumerate(person.skeleton.joints):
        at_root = joint == person.skeleton.root
        position = person.fitted.root[0] if at_root else person.fitted.offsets[joint]
        children = [
            first + c for c, parent in enumerate(person.skeleton.parents) if parent == joint
        ]
        node: dict[str, Any] = {
            "name": f"{person.name}_{name}",
            "translation": position.astype(np.float32).tolist(),
        }
        nodes.append(node | ({"children": children} if children else {}))
    return nodes


def _person_nodes(person: AnimatedPerson, first: int, number: int) -> list[dict[str, Any]]:
    """Describe the node above the joints, which Blender makes an armature of, and the mesh.

    The roots of two people in the scene itself would become one armature. A skinned mesh stays in
    the scene: transforms of a node above it do not apply.
    """
    return [
        {"name": f"person_{person.name}", "children": [first + person.skeleton.root]},
        {"name": person.name, "mesh": number, "skin": number},
    ]


def _mesh(person: AnimatedPerson, buffer: BinaryBuffer, material: int) -> dict[str, Any]:
    skin = person.skin
    joints = np.zeros((len(skin.joints), 4), np.uint16)
    joints[:, 0] = skin.joints
    weights = np.zeros((len(skin.joints), 4), np.float32)
    weights[:, 0] = 1
    attributes = {
        "POSITION": buffer.add(skin.positions, VERTICES, bounds=True),
        "NORMAL": buffer.add(skin.normals, VERTICES),
        "JOINTS_0": buffer.add(joints, VERTICES),
        "WEIGHTS_0": buffer.add(weights, VERTICES),
    }
    indices = buffer.add(skin.faces.astype(np.uint32).reshape(-1), INDICES)
    return {
        "name": person.name,
        "primitives": [{"attributes": attributes, "indices": indices, "material": material}],
    }


def _material(person: AnimatedPerson) -> dict[str, Any]:
    material = {
        "baseColorFactor": [*person.colour, 1.0],
        "metallicFactor": 0,
        "roughnessFactor": 0.65,
    }
    return {"name": person.name, "pbrMetallicRoughness": material}


def _skin(person: AnimatedPerson, buffer: BinaryBuffer, first: int) -> dict[str, Any]:
    """Bind the mesh to the joints: inverse bind matrices of the rest pose."""
    inverse_bind = np.tile(np.eye(4, dtype=np.float32), (len(person.skeleton.joints), 1, 1))
    # Row 3 is column 3 as stored.
    inverse_bind[:, 3, :3] = -rest_positions(person.fitted, person.skeleton)
    return {
        "joints": list(range(first, first + len(person.skeleton.joints))),
        "inverseBindMatrices": buffer.add(inverse_bind),
        "skeleton": first + len(person.skeleton.joints),
    }


def _animate(
    animation: dict[str, Any],
    person: AnimatedPerson,
    buffer: BinaryBuffer,
    numbers: tuple[int, int],
) -> None:
    """Add the channels: the root's translation and the rotation of every joint."""
    clock, first = numbers
    animated = [(person.skeleton.root, "translation", person.fitted.root.astype(np.float32))]
    animated += [
        (joint, "rotation", quaternions(person.fitted.rotations[:, joint]))
        for joint in range(len(person.skeleton.joints))
    ]
    for joint, path, values in animated:
        target = {"node": first + joint, "path": path}
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": target})
        animation["samplers"].append({"input": clock, "output": buffer.add(values)})
