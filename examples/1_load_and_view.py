"""Sample clips of the embedded default, look at one's numbers, and play three of them."""

import sys
from pathlib import Path

import pacmo_core

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
clips = pacmo_core.synthesise(11)
# Captures of yours: pacmo_core.load_clips("data/captures/sbu", "sbu", fps=15.0)

for name, clip in clips.items():
    print(f"{name:14} {len(clip.times):4} frames {clip.fps:.0f} fps {clip.skeleton.name}")

chosen = {name: clips[name] for name in ("handshake-1", "hug-1", "circle dance-1")}
print(pacmo_core.view(chosen, folder / "clips.html"))
