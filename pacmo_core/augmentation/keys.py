"""What a variation rests on, as a hash: the same hash, the same bytes.

A variation does not depend on the others that are made with it
(tests/augmentation/test_company.py), so it can be cached under its own hash, and another plan
computes just what is new.
"""

import hashlib
import json
from dataclasses import asdict

from pacmo_core.augmentation.bodies import Scales
from pacmo_core.data.interaction import Interaction
from pacmo_core.interaction_mesh import Settings
from pacmo_core.store.cache import code_hash

# What a variation runs: an edit elsewhere does not cost what is kept.
CODE = (
    *("data/skeleton.py", "interaction_mesh/*.py"),
    *("augmentation/solve.py", "augmentation/shape.py", "augmentation/segments.py"),
)
PACKAGES = ("numpy", "scipy")
LENGTH = 32  # characters of a hash


def maker_key(settings: Settings) -> str:
    """Hash what makes variations: the solver's settings, the code, the versions it runs on."""
    text = json.dumps([asdict(settings), code_hash(CODE, PACKAGES)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:LENGTH]


def source_key(interaction: Interaction) -> str:
    """Hash what is varied: both motions, their rate and their skeleton, whatever its name."""
    skeleton = interaction.skeleton
    facts = [interaction.fps, skeleton.joints, skeleton.parents, skeleton.left_right]
    digest = hashlib.sha256(json.dumps(facts).encode())
    for motion in (interaction.person_a, interaction.person_b):
        digest.update(motion.astype("<f4").tobytes())
    return digest.hexdigest()[:LENGTH]


def body_key(scales: tuple[Scales, Scales]) -> str:
    """Hash the bodies that are given."""
    digest = hashlib.sha256()
    for own in scales:
        digest.update(own.astype("<f8").tobytes())
    return digest.hexdigest()[:LENGTH]
