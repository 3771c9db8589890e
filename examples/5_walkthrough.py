# %% [markdown]  A walk through the library; its picture is that of docs/library.md.
import sys
from pathlib import Path

import pacmo_core
from pacmo_core.figures.stills import film_strip
from pacmo_core.figures.viewer import Scene

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures")
n_epochs = int(sys.argv[2]) if len(sys.argv) > 2 else 40

# %% Clips of the embedded default, as a depth camera records them
clips = pacmo_core.synthesise(100)
clip = clips["high five-1"]

# %% A regression trained for seconds on the others, and its reaction to person a of the clip
training = [other for name, other in clips.items() if name != "high five-1"]
model = pacmo_core.train("regression", training, n_epochs=n_epochs)
(reaction,) = pacmo_core.react(model, clip)

# %% The same high five of a tall adult and a child
retargeted = pacmo_core.retarget(clip, a="tall_adult", b="child")

# %% Five frames of each
frames = [round(share * (len(clip.times) - 1)) for share in (0.0, 0.3, 0.45, 0.6, 1.0)]
rows = {"captured": clip, "reaction to a": reaction, "retargeted": retargeted}
strip = [(Scene.of(title, interaction), frames) for title, interaction in rows.items()]
film_strip(strip, min_width=1.9, inches=1.8).savefig(folder / "library.png", dpi=90)
