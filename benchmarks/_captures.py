"""Real captures for the benchmarks, if this machine has them."""

import os
from pathlib import Path

from benchmarks._sampling import Sampled
from pacmo_core.formats.base import Format
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.joint_names import StatedNames, name_joints
from pacmo_core.formats.sbu import Sbu
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.windows import max_duration

BVH = BvhPairs(
    preset="duo_mocap",
    unit=None,
    up=None,
    fps=None,
    end_sites=False,
    skip_frames=0,
    max_root_distance=2.0,
)
# Salsa was recorded at 120 fps, SBU at 15.
SETS: dict[str, tuple[Format, str]] = {
    "sbu": (Sbu(fps=15), "sbu"),
    "salsa": (BVH, "duo_mocap/salsa_raw"),
}
SALSA_SECONDS = 4.0
MAX_CLIPS = 60  # of a dataset
MIN_FRAMES = 20


def real_data() -> Path:
    """Return the folder of real captures."""
    return Path(os.environ.get("PACMO_REAL_DATA", "../shared/data"))


def captures_of(model: Generator) -> tuple[str, list[Sampled]]:
    """Return the dataset that has a model's joints, and clips no longer than in its training."""
    root = real_data()
    for name, (form, folder) in SETS.items():
        if not (root / folder).is_dir():
            continue
        clips: list[Sampled] = []
        for sequence in form.find(root / folder)[:MAX_CLIPS]:
            clip = form.read(sequence).interaction
            try:
                names = name_joints(clip.skeleton, model.skeleton, StatedNames())
            except ValueError:  # a joint of the model that these captures lack
                break
            partner = Sampled(names.apply(clip.person_a), clip.times)
            clips += _cut(partner, max_duration(model.normalisation))
        if clips:
            return name, clips[:MAX_CLIPS]
    return "", []


def _cut(whole: Sampled, longest: float) -> list[Sampled]:
    """Cut into clips of four seconds, or of the longest duration that the model knows."""
    fps = (len(whole.times) - 1) / (whole.times[-1] - whole.times[0])
    # One more than a multiple of four, so that every fourth frame includes both ends.
    size = 4 * int(min(SALSA_SECONDS, longest) * fps // 4) + 1
    starts = range(0, max(1, len(whole.times) - size + 1), size)
    pieces = [Sampled(whole.motion[s : s + size], whole.times[s : s + size]) for s in starts]
    trimmed = [p.first(4 * ((len(p.times) - 1) // 4) + 1) for p in pieces]
    return [piece for piece in trimmed if len(piece.times) >= MIN_FRAMES]
