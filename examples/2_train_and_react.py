"""Train a small PaCMO for a minute and generate three reactions to a partner it has not seen."""

import sys
from pathlib import Path

import pacmo_core

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
n_epochs = int(sys.argv[2]) if len(sys.argv) > 2 else 20
clips = pacmo_core.synthesise(60)
*training, held_out = clips.values()

# Far smaller than the default of params.yaml, whose training takes five minutes.
size = {"width": 16, "n_points": 17, "modes": [8, 6, 4, 4, 4, 6, 8]}
model = pacmo_core.train("pacmo", training, n_epochs=n_epochs, **size)
reactions = pacmo_core.react(model, held_out, n_samples=3)
shown = {f"sample {number}": reaction for number, reaction in enumerate(reactions)}
print(pacmo_core.view({"captured": held_out, **shown}, folder / "reactions.html"))
