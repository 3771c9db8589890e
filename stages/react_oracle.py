"""Draw every test clip's reactions once more from the true law, where the captures came with one.

Usage: python -m stages.react_oracle RAW CLIPS SIDES.parquet REACTIONS

The embedded default does; recorded captures do not, and have no oracle: no reaction is written.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.names import direction_of
from pacmo_core.data.skeleton import NTU25
from pacmo_core.store.motions import read_skeleton, write_motions
from pacmo_core.store.tables import ClipRecord
from pacmo_core.synthesis.capture import sample_oracle_reaction
from pacmo_core.synthesis.script import Script
from stages._files import LAW, MOTIONS, read_json
from stages._params import read_params
from stages._reactions import seed_of, write_reactions


@dataclass(frozen=True)
class Params:
    """The ``react_oracle`` section of ``params.yaml``."""

    random_seed: int


def main(raw: Path, clips: Path, sides: Path, reactions: Path) -> None:
    params = read_params("react_oracle", Params)
    if not (raw / LAW).exists():
        with write_motions(reactions / MOTIONS, read_skeleton(clips / MOTIONS)):
            return
    law = read_json(raw / LAW)

    def answer(name: str, facts: ClipRecord, seen: Interaction) -> list[Motion]:
        script = Script.from_json(law[facts.sequence])
        random = np.random.default_rng(seed_of(name, params.random_seed))
        motion = sample_oracle_reaction(script, direction_of(name), random)
        window = slice(facts.start_frame, facts.start_frame + facts.frames)
        return [motion[window][:, NTU25.indices(seen.skeleton.joints)]]

    write_reactions(clips, sides, reactions, answer)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
