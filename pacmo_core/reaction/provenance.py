"""What a model was trained on and with, as facts that stand beside its weights."""

import hashlib
from collections.abc import Iterable

import numpy as np

from pacmo_core.data.interaction import Interaction


def data_hash(clips: Iterable[Interaction]) -> str:
    """SHA-256 of clips in their order, in hexadecimal: skeletons, instants and motions."""
    digest = hashlib.sha256()
    for clip in clips:
        digest.update(f"{clip.skeleton!r} {clip.person_a.shape}".encode())
        for values in (clip.times, clip.person_a, clip.person_b):
            digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
