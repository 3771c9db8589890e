"""Sample the oracle's reactions: of the true distribution, if the captures are synthetic.

Usage: python -m stages.react_oracle RAW CLIPS SPLITS.parquet REACTIONS

Recorded captures have no oracle: no reaction is written.
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
from stages.common.clips import clip_seed, write_reactions
from stages.common.files import MOTIONS, SCRIPTS, read_json
from stages.common.params import read_params, run_stage


@dataclass(frozen=True)
class Params:
    """The ``react_oracle`` section of ``params.yaml``."""

    random_seed: int
    n_samples: int  # for each partner


def main(raw: Path, clips: Path, splits: Path, reactions: Path) -> None:
    params = read_params("react_oracle", Params)
    if not (raw / SCRIPTS).exists():
        with write_motions(reactions / MOTIONS, read_skeleton(clips / MOTIONS)):
            return
    scripts = read_json(raw / SCRIPTS)

    def sample_reaction(name: str, facts: ClipRecord, directed: Interaction) -> list[Motion]:
        script = Script.from_json(scripts[facts.sequence])
        random = np.random.default_rng(clip_seed(name, params.random_seed))
        window = slice(facts.start_frame, facts.start_frame + facts.frames)
        joints = NTU25.indices(directed.skeleton.joints)
        samples = (
            sample_oracle_reaction(script, direction_of(name), random)
            for _ in range(params.n_samples)
        )
        return [motion[window][:, joints] for motion in samples]

    write_reactions(clips, splits, reactions, sample_reaction)


if __name__ == "__main__":
    run_stage(main, *map(Path, sys.argv[1:]))
