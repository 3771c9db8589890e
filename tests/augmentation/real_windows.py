"""Windows of real captures."""

from pacmo_core.data.interaction import Interaction
from pacmo_core.formats.bvh_pairs import BvhPairs
from tests.formats.real_files import real_folder


def salsa_window(n_frames: int) -> Interaction:
    """Cut the middle of a salsa."""
    pairs = BvhPairs(
        preset="duo_mocap", unit=None, up=None, fps=None, end_sites=False, skip_frames=0,
        max_root_distance=2.0,
    )  # fmt: skip
    (found,) = [s for s in pairs.find(real_folder("duo_mocap")) if s.name == "salsa/Easy_01_30fps"]
    whole = pairs.read(found).interaction
    start = len(whole.times) // 2
    return whole.frames(start, start + n_frames)
