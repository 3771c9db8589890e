"""Small invented reports: layout only, no figure of theirs means anything."""

import base64

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import SBU15, Skeleton
from pacmo_core.figures import Curve, DataSummary, Panel, PlayedClip, QuarantineRow, Report
from pacmo_core.figures.tables import Cell


def interaction(
    random_seed: int, skeleton: Skeleton = SBU15, n_frames: int = 12, fps: float = 15.0
) -> Interaction:
    """Two clouds of joints, a metre apart, that wander."""
    rng = np.random.default_rng(random_seed)
    shape = (n_frames, len(skeleton.joints), 3)
    steps = rng.normal(0.0, 0.01, (2, *shape)).cumsum(axis=1)
    stance = rng.uniform((-0.3, 0.0, -0.3), (0.3, 1.7, 0.3), (len(skeleton.joints), 3))
    motions = (steps + stance).astype(np.float32)
    motions[1, ..., 0] += 1
    return Interaction(skeleton, np.arange(n_frames) / fps, motions[0], motions[1])


def cell(mean: float, half_width: float = 0.01) -> Cell:
    """Put an interval round a mean."""
    return {"mean": mean, "low": mean - half_width, "high": mean + half_width}


def report(name: str = "s01s02/08/001", n_clips: int = 2) -> Report:
    """Fill every part of a report."""
    clips = [
        PlayedClip(
            name,
            "punching",
            (Panel("real", interaction(i)), Panel("pacmo", interaction(i + 10, fps=30.0))),
        )
        for i in range(n_clips)
    ]
    missing: Cell = {"mean": None, "missing": "no error of its own"}
    return Report(
        title=f"experiment {name}",
        summary=f"about {name}",
        facts={"command": name, "commit": "0123abc"},
        data=DataSummary(
            files_read=5,
            clips=2,
            quarantined=(
                QuarantineRow(f"{name}.txt", 3, "wanted 91 values; got 90"),
                QuarantineRow("b.txt", 9, "wanted 91 values; got 90"),
                QuarantineRow("c.txt", None, f"{name} is empty"),
            ),
            facts={"people": name},
            split={"method": "by people"},
        ),
        tables={
            "pacmo": {
                "real": {
                    "f2id": cell(0.03),
                    "ape": missing,
                },
                "pacmo": {"f2id": cell(0.20), "ape": cell(0.3)},
                "gru": {"f2id": cell(0.50), "ape": cell(0.31)},
            },
            name: {name: {name: cell(1.0)}},
        },
        notes=(f"features by {name}",),
        curves={name: Curve([0, 1, 2], {name: [3.0, 2.0, 1.0]}, name)},
        clips=tuple(clips),
    )


def unpack_motion(text: str, origin: np.ndarray, step: float) -> np.ndarray:
    """Decode what ``pack_motion`` wrote, as the page does: ``(N, 3)`` metres."""
    return origin + np.frombuffer(base64.b64decode(text), "<i2").reshape(-1, 3) * step
