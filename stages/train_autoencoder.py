"""Train the auto-encoder whose bottleneck gives the features of the metrics.

Usage: python -m stages.train_autoencoder CLIPS SIDES.parquet MODEL CURVE.csv
"""

from dataclasses import dataclass
from pathlib import Path

from pacmo_core.pacmo import autoencoder
from pacmo_core.pacmo.settings import AutoencoderSettings
from stages._params import read_params
from stages._runs import fold_arguments
from stages._training import clips_of, train, use_threads, write_model


@dataclass(frozen=True)
class Params(AutoencoderSettings):
    """The ``train_autoencoder`` section of ``params.yaml``."""

    threads: int


def main(clips: Path, sides: Path, model: Path, curve: Path) -> None:
    params = read_params("train_autoencoder", Params)
    use_threads(params.threads)
    fitting = autoencoder.fit(
        clips_of(clips, sides, "train"), params, validation=clips_of(clips, sides, "validation")
    )
    train(fitting, params.n_epochs, curve)
    write_model(model, "autoencoder", fitting.model, autoencoder.config(fitting.model))


if __name__ == "__main__":
    main(**fold_arguments())
