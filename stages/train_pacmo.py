"""Train PaCMO: generator against critic.

Usage: python -m stages.train_pacmo [--section=NAME] --seed=S CLIPS SIDES.parquet MODEL CURVE.csv
"""

from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import adversarial
from pacmo_core.pacmo.settings import PacmoSettings
from stages._params import read_params
from stages._runs import run_arguments
from stages._training import clips_of, train, use_threads, write_model


@dataclass(frozen=True)
class Params(PacmoSettings):
    """The ``train_pacmo`` section of ``params.yaml``, and the seed of the run."""

    threads: int


def main(clips: Path, sides: Path, model: Path, curve: Path, *, section: str, seed: int) -> None:
    params = read_params(section, Params, given={"random_seed": seed})
    use_threads(params.threads)
    fitting = adversarial.fit(
        clips_of(clips, sides, "train"), params, validation=clips_of(clips, sides, "validation")
    )
    train(fitting, params.n_steps, curve)
    write_model(model, "pacmo", fitting.model, adversarial.config(fitting.model))


if __name__ == "__main__":
    main(**vars(run_arguments("train_pacmo")))
