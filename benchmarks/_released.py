"""The seams of the augmentation paper's own released motions, by the measure of our reports."""

import os
from pathlib import Path

from pacmo_core.formats.bvh import read_bvh
from pacmo_core.interaction_mesh.report import acceleration_ratios

WINDOW = 40  # frames after which an acceleration stands out in all of them


def released_seam_ratio() -> float | None:
    """Give the worst mean acceleration at a seam over the median of those around it.

    The released sample has no source beside it, whose own jolts could be taken off; frames
    elsewhere are left out therefore.
    """
    root = Path(os.environ.get("PACMO_REAL_DATA", "../shared/data")) / "skeleton_priors"
    files = sorted(root.rglob("*.bvh"))
    if not files:
        return None
    # Row i is the acceleration of frame i + 1.
    return max(
        float(acceleration_ratios(read_bvh(f).positions()[..., None])[WINDOW - 2 :: WINDOW].max())
        for f in files
    )
