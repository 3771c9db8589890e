"""What a variation rests on, as a hash: the same hash, the same bytes.

A variation does not depend on the others that are made with it (tests/augmentation/test_company.py),
so it can be kept under its own hash, and another plan makes just what is new.
"""

import hashlib
import json
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pacmo_core
from pacmo_core.augmentation.bodies import Scales
from pacmo_core.data.interaction import Interaction
from pacmo_core.interaction_mesh import Settings

# What a variation runs: an edit elsewhere does not cost what is kept.
CODE = (
    *("skeleton.py", "interaction_mesh/*.py"),
    *("variations/solve.py", "variations/shape.py", "variations/segments.py"),
)
PACKAGES = ("numpy", "scipy")
LENGTH = 32  # characters of a hash


def maker_key(settings: Settings) -> str:
    """Hash what makes variations: the solver's settings, the code, the versions it runs on."""
    text = json.dumps([asdict(settings), code_key(CODE, PACKAGES)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:LENGTH]


@cache
def code_key(code: tuple[str, ...], packages: tuple[str, ...]) -> str:
    """Hash what this process has loaded: once, for files may change while it runs.

    Parameters
    ----------
    code : patterns of files of the core
    packages : whose versions matter
    """
    digest = hashlib.sha256()
    for package in packages:
        digest.update(f"{package} {version(package)}\0".encode())
    root = Path(pacmo_core.__path__[0])
    for path in (path for pattern in code for path in sorted(root.glob(pattern))):
        digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


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
