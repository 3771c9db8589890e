"""Train the GRU baseline.

Usage: python -m stages.train_gru --seed=S CLIPS SIDES.parquet MODEL CURVE.csv
"""

from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import gru
from pacmo_core.pacmo.settings import GruSettings
from stages._params import read_params
from stages._runs import run_arguments
from stages._training import clips_of, train, use_threads, write_model


@dataclass(frozen=True)
class Params(GruSettings):
    """The ``train_gru`` section of ``params.yaml``, and the seed of the run."""

    threads: int


def main(clips: Path, sides: Path, model: Path, curve: Path, *, section: str, seed: int) -> None:
    params = read_params(section, Params, given={"random_seed": seed})
    use_threads(params.threads)
    fitting = gru.fit(
        clips_of(clips, sides, "train"), params, validation=clips_of(clips, sides, "validation")
    )
    train(fitting, params.n_epochs, curve)
    write_model(model, "gru", fitting.model, gru.config(fitting.model))


if __name__ == "__main__":
    main(**vars(run_arguments("train_gru")))
