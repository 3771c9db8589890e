"""React to the partner of every test clip without a model: rows that a trained model should beat.

Usage: python -m stages.react_untrained --row={mean,nearest_neighbour,nearest_neighbour_finished}
           CLIPS SPLITS.parquet REACTIONS
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.finish.finish import finish
from pacmo_core.finish.learning import fitted_on, learn
from pacmo_core.metrics.untrained import TrainingReactions
from stages.common.clips import stream_split, write_reactions
from stages.common.params import read_params, run_stage

ROWS = ("mean", "nearest_neighbour", "nearest_neighbour_finished")
React = Callable[[Interaction], Motion]


@dataclass(frozen=True)
class Params:
    """The ``react_untrained`` section of ``params.yaml``."""

    n_points: int  # times in [0, 1] at which motions are compared and averaged

    def __post_init__(self) -> None:
        if self.n_points < 2:
            raise ValueError(f"n_points must be at least 2; got {self.n_points}")


def main(row: str, clips: Path, splits: Path, reactions: Path) -> None:
    params = read_params("react_untrained", Params)
    training = [interaction for _, interaction in stream_split(clips, splits, "train")]
    data = TrainingReactions.of(training, params.n_points)
    react: React = data.mean if row == "mean" else data.nearest
    if row == "nearest_neighbour_finished":
        validation = [interaction for _, interaction in stream_split(clips, splits, "validation")]
        react = finished(data.nearest, fitted_on(validation, training), training[0].skeleton)
    write_reactions(clips, splits, reactions, lambda _, __, directed: [react(directed)])


def finished(react: React, known: Sequence[Interaction], skeleton: Skeleton) -> React:
    """Finish reactions as a model's are: by what reactions to the partners of clips teach."""
    directed = [clip for one in known for clip in (one, one.swapped())]
    learnt = learn([(clip, react(clip)) for clip in directed], skeleton)
    return lambda clip: finish(react(clip), clip.person_a, clip.times, skeleton, learnt)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--row", choices=ROWS, required=True)
    for name in ("clips", "splits", "reactions"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, **vars(arguments()))
