"""Retarget a handshake: person b becomes a child, person a gets longer arms."""

import sys
from pathlib import Path

import pacmo_core

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
clip = pacmo_core.synthesise(10)["handshake-1"]
# Two BVH files of yours, NAME_A.bvh and NAME_B.bvh, in centimetres:
# settings = {"unit": 0.01, "up": "y", "fps": None, "end_sites": False, "skip_frames": 0}
# clips = pacmo_core.load_clips("folder", "bvh", preset="pair", max_root_distance=None, **settings)

child = pacmo_core.retarget(clip, b="child")
arms = pacmo_core.retarget(clip, a={"left_forearm": 1.2, "right_forearm": 1.2})
panels = {"source": clip, "b a child": child, "a with longer forearms": arms}
print(pacmo_core.view(panels, folder / "retargeted.html"))
