"""Train one model of reactions, or of the features that metrics use, on one fold's training clips.

Usage: python -m stages.train --model=NAME [--seed=S] [--variations=DIR --share=X]
           CLIPS SPLITS.parquet MODEL CURVE.csv

NAME is a row of pacmo_core/models.py; settings are its section of params.yaml, of which a variant
replaces some. DIR holds variations of the clips, which replace a clip in a share X of the times
that it is shown. Processes can share each batch:
    torchrun --standalone --nproc-per-node 2 -m stages.train ...
"""

import argparse
import sys
from dataclasses import make_dataclass, replace
from pathlib import Path
from typing import Any

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import split_variation_name
from pacmo_core.models import MODELS, Model
from pacmo_core.reaction.variations import TrainingVariations
from pacmo_core.store.files import StoreError, file_hash
from pacmo_core.store.motions import stream_folder
from pacmo_core.store.weights import TrainedOn, read_trained_on
from pacmo_core.training.loop import TrainingData
from stages.common.clips import stream_split
from stages.common.params import ParamsError, StageError, read_params, run_stage
from stages.common.training import Task, train


def main(paths: argparse.Namespace) -> None:
    if paths.model_name not in MODELS:
        raise ParamsError(
            "runs.models", f"wanted some of {', '.join(MODELS)}; got {paths.model_name}"
        )
    model = MODELS[paths.model_name]
    params = read_settings(model, paths)
    trained_on = read_trained_on_before(params)
    data = read_training_data(paths.clips, paths.splits)
    records = (facts for facts, _ in stream_split(paths.clips, paths.splits, "train"))
    trained_on += TrainedOn.of(records)
    extra: dict[str, Any] = {}
    checkpoint_data = data
    if paths.variations:
        extra["variations"] = read_variations(paths)
        # All that it is trained on, and so what a checkpoint depends on.
        checkpoint_data = replace(data, train=[*data.train, *extra["variations"].interactions])
    task = Task(
        model,
        params,
        checkpoint_data,
        trained_on,
        lambda device: model.build_training(data, params, device=device, **extra),
    )
    train(task, paths.model, paths.curve)


def read_settings(model: Model, paths: argparse.Namespace) -> Any:
    """Read the model's section of ``params.yaml``; the seed of a run is on the command line."""
    fields: list[tuple[str, type]] = [("threads", int)]
    given: dict[str, object] = {}
    if paths.seed is not None:
        given["random_seed"] = paths.seed
    if paths.variations:
        fields.append(("share", float))
        given["share"] = paths.share
    kind = make_dataclass(
        "Params", fields, bases=(model.settings_class(),), frozen=True, kw_only=True
    )
    return read_params(model.section, kind, given=given, changes=model.changes)


def read_trained_on_before(params: Any) -> TrainedOn:
    """Return what the weights that a training continues from were trained on; else nothing.

    Raises
    ------
    StageError
        If their file is missing, or another than stated.
    """
    start = getattr(params, "start", None)
    if start is None or not start.weights:
        return TrainedOn((), 0, 0)
    file = Path(start.weights)
    try:
        found = file_hash(file)
        if found != start.sha256:
            raise StageError(f"{file}: wanted the SHA-256 {start.sha256}; got {found}")
        trained_on = read_trained_on(file) or TrainedOn((), 0, 0)
    except (OSError, StoreError) as fault:
        raise StageError(f"train_pacmo.start: {fault}") from fault
    sys.stdout.write(f"continues from {file}, which keeps {start.share:.0%} of the weights\n")
    return trained_on


def read_training_data(clips: Path, splits: Path) -> TrainingData[Interaction]:
    """Read a fold's training and validation clips into memory."""
    train_split, validation = (
        list(stream_split(clips, splits, split)) for split in ("train", "validation")
    )
    return TrainingData(
        [interaction for _, interaction in train_split],
        [interaction for _, interaction in validation],
        [facts.action for facts, _ in train_split],
        [facts.action for facts, _ in validation],
    )


def read_variations(paths: argparse.Namespace) -> TrainingVariations:
    """Read the variations of the training clips into memory.

    Raises
    ------
    ValueError
        If there are none.
    """
    training_clips = stream_split(paths.clips, paths.splits, "train")
    numbers = {facts.clip: number for number, (facts, _) in enumerate(training_clips)}
    variations, sources = [], []
    for name, motion in stream_folder(paths.variations):
        source, _ = split_variation_name(name)
        if source in numbers:
            variations.append(motion)
            sources.append(numbers[source])
    if not variations:
        raise ValueError(f"{paths.variations}: wanted variations of training clips, found none")
    return TrainingVariations(interactions=variations, sources=sources, share=paths.share)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--model", dest="model_name", required=True, help="row of the registry")
    parser.add_argument("--seed", type=int, help="of this run; absent where the section has one")
    parser.add_argument("--variations", type=Path, help="folder of variations of the clips")
    parser.add_argument("--share", type=float, help="of times that a variation replaces a clip")
    for name in ("clips", "splits", "model", "curve"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    run_stage(main, arguments())
