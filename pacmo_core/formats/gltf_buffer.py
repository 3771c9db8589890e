"""The binary side of a glTF 2.0 file: arrays laid end to end, and what tells them apart."""

import base64
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

_TYPES = {
    np.dtype(np.float32): 5126,
    np.dtype(np.uint32): 5125,
    np.dtype(np.uint16): 5123,
    np.dtype(np.uint8): 5121,
}
_SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
VERTICES, INDICES = 34962, 34963
_GLB, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942


class Buffer:
    """Arrays added one after another; each is then known by the number of its accessor."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: NDArray[Any], target: int = 0, *, bounds: bool = False) -> int:
        """Append an array ``(N, ...)`` and name its accessor.

        Parameters
        ----------
        target : ``VERTICES`` or ``INDICES`` for what is drawn
        bounds : state the least and greatest values, as the standard asks of places and times
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
    """Put a document and its data into one binary file."""
    text = json.dumps(_with(document, {"byteLength": len(data)}), separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    length = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<III", _GLB, 2, length) + struct.pack("<II", len(text), _JSON)
    return head + text + struct.pack("<II", len(data), _BIN) + data


def to_gltf(document: dict[str, Any], data: bytes) -> bytes:
    """Put a document and its data into one file of JSON."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    whole = _with(document, {"byteLength": len(data), "uri": uri})
    return json.dumps(whole, separators=(",", ":")).encode()


def _with(document: dict[str, Any], buffer: dict[str, Any]) -> dict[str, Any]:
    return {**document, "buffers": [buffer]}
