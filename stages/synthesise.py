"""Write the embedded default: raw NTU files of two people, and the scripts they are sampled from.

Usage: python -m stages.synthesise RAW
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.formats.write_ntu import format_ntu
from pacmo_core.store.files import atomic_file
from pacmo_core.synthesis.capture import sample_interaction
from pacmo_core.synthesis.script import ACTIONS, file_name, sample_scripts
from stages.common.files import SCRIPTS, write_json
from stages.common.params import read_params, run_stage

BODY_ID = 72057594037900000  # the published body numbers have 17 digits and begin like this


@dataclass(frozen=True)
class Params:
    """The ``synthesise`` section of ``params.yaml``."""

    random_seed: int
    n_pairs: int  # pairs of people
    replications: int  # of each action by each pair


def main(raw: Path) -> None:
    params = read_params("synthesise", Params)
    scripts = sample_scripts(
        params.random_seed,
        population=params.random_seed,
        pairs=params.n_pairs,
        actions=tuple(ACTIONS),
        replications=params.replications,
    )
    written = {}
    for number, (script, random) in enumerate(scripts):
        name = file_name(script)
        ids = (BODY_ID + 2 * number, BODY_ID + 2 * number + 1)
        with atomic_file(raw / f"{name}.skeleton") as partial:
            partial.write_bytes(format_ntu(sample_interaction(script, random), ids))
        written[name] = script.to_json()
    write_json(raw / SCRIPTS, written)


if __name__ == "__main__":
    run_stage(main, *map(Path, sys.argv[1:]))
