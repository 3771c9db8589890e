"""Draw the pictures of docs/embedded_default.md.

Usage: python docs/pictures.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.figures.stills import film_strip
from pacmo_core.figures.viewer import Scene
from pacmo_core.synthesis import (
    ACTIONS,
    Script,
    sample_interaction,
    sample_oracle_reaction,
    sample_scripts,
)
from pacmo_core.synthesis.script import Role

POPULATION, RANDOM_SEED, PAIRS = 1, 4, 6
Row = tuple[Scene, list[int]]


def clip(act: str, pair: int) -> tuple[Script, np.random.Generator]:
    """Write one clip of an act by one pair."""
    written = sample_scripts(
        RANDOM_SEED, population=POPULATION, pairs=PAIRS, actions=(act,), replications=1
    )
    return list(written)[pair]


def instants(script: Script) -> list[int]:
    """Choose five frames: before, on the way, the event, the response, the end."""
    last, event = len(script.frame_times) - 1, round(30 * script.event)
    middle = event + max(8, round(15 * script.hold))
    if script.action in ("approach", "depart"):
        return [round(share * last) for share in (0.0, 0.25, 0.45, 0.65, 0.85)]
    frames = [0, event - 12, event, middle, round(30 * (script.event + script.hold)) + 15]
    return [min(max(frame, 0), last) for frame in frames]


def acts(names: list[str]) -> list[Row]:
    """Take one clip of each act, by different pairs."""
    rows: list[Row] = []
    for name in names:
        script, random = clip(name, list(ACTIONS).index(name) % PAIRS)
        rows.append((Scene.of(name, sample_interaction(script, random)), instants(script)))
    return rows


def oracle() -> list[Row]:
    """Keep one push and the pusher; draw the reaction three times."""
    script, random = clip("push", 3)
    real = sample_interaction(script, random)
    role: Role = "b" if script.initiator == "a" else "a"
    event = round(30 * script.event)
    frames = [min(event + late, len(script.frame_times) - 1) for late in (-6, 0, 8, 16, 24)]
    rows: list[Row] = [(Scene.of("as captured", real), frames)]
    for draw in (1, 2, 3):
        fresh = sample_oracle_reaction(script, role, np.random.default_rng(draw))
        people = (real.person_a, fresh) if role == "b" else (fresh, real.person_b)
        again = Interaction(real.skeleton, real.times, *people)
        rows.append((Scene.of(f"fresh reaction {draw}", again), frames))
    return rows


def main(folder: Path) -> None:
    """Write the three pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    names = list(ACTIONS)
    pictures = {"acts_1": acts(names[:6]), "acts_2": acts(names[6:]), "oracle": oracle()}
    for name, rows in pictures.items():
        figure = film_strip(rows, min_width=1.9, inches=1.9)
        figure.savefig(folder / f"{name}.png", dpi=100, metadata={"Software": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "pictures")
