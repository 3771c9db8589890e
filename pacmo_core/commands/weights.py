"""Weights that commands use: which, what they were trained on, and those in the package.

Usage: python -m pacmo_core.commands.weights MODEL METRICS.json
       python -m pacmo_core.commands.weights --prior MODEL EVALUATION.json

copies the weights of a finished run into the package, with a card of what they are: MODEL is the
folder of a trained model of reactions, or with ``--prior`` of a skeleton prior; METRICS.json is
``reports/metrics.json`` of the same run, EVALUATION.json its ``reports/skeleton_prior.json``.
"""

import argparse
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from pacmo_core.models import load_reaction_model, load_skeleton_prior
from pacmo_core.project.workspace import CommandError, in_project
from pacmo_core.reaction.inference import PACKAGED
from pacmo_core.store.files import StoreError, file_hash, write_text
from pacmo_core.store.tables import ClipRecord, read_rows
from pacmo_core.store.weights import read_trained_on, read_weights, write_weights

# Of the model of reactions that is used if none is named: that of a run here, else the package's.
TRAINED_HERE = Path("models/1/pacmo/1/weights.safetensors")
CARD = PACKAGED.with_suffix(".json")
MAX_BYTES = 4_000_000  # of the packaged weights
# The same of the skeleton prior, with what its training adds to its start in the card.
PRIOR_TRAINED_HERE = Path("models/priors/default/random/kinematic/1/weights.safetensors")
PACKAGED_PRIOR = PACKAGED.with_name("starting_prior.safetensors")
MAX_PRIOR_BYTES = 1_000_000
LICENCE = "Apache-2.0"
LIMITS = (
    "Trained on synthetic motion of eleven scripted actions alone: the scores are those of new "
    "synthetic people. On SBU's recorded partners (docs/results_recorded.md) hands meet "
    "in 0.72 of the reactions in which they should and in 0.27 of the others; half of the contacts "
    "are met, and one frame in seven without contact has one, which is not significantly different "
    "from a captured reaction to another partner; on those of CMU and on handovers fewer contacts "
    "are met and more are false. On recorded partners the same training "
    "with three other seeds meets as many or fewer contacts.",
    "The scores are of the default's 14 test pairs, one seed; copies, regression and no_noise are "
    "of the same clips without parts, finished as in the version before. That training on parts is "
    "shipped was decided on SBU's figures. The falling learning rate was suggested by scores on "
    "test partners; that these weights are shipped was decided on validation partners.",
    "Two people, 21 joints, actions of a few seconds; longer motion is divided into windows.",
    "Kicks and punches may stop short, blows come late or early, and who is struck may not recoil; "
    "feet may stand crossed or close while the body turns, and a foot may slide.",
)

_CLIPS = "clips.parquet"  # beside stored motions
_SCRIPTS = "scripts.json"  # beside the raw captures of the embedded default


def default_weights() -> Path:
    """Return the weights of a model of reactions that are used if none are named."""
    trained = in_project(TRAINED_HERE)
    return trained if trained.exists() else PACKAGED


def default_prior() -> Path:
    """Return the weights of a skeleton prior that are used if none are named."""
    trained = in_project(PRIOR_TRAINED_HERE)
    return trained if trained.exists() else PACKAGED_PRIOR


def find_weights(weights: Path | None) -> Path:
    """Return the file of weights of a model of reactions.

    Parameters
    ----------
    weights : that were named, where ``package`` is those in the package; None: the default

    Raises
    ------
    CommandError
        If there is no such file: with where weights come from.
    """
    if weights is None:
        return default_weights()
    if weights == Path("package") and not weights.exists():
        return PACKAGED
    if not weights.exists():
        raise CommandError(
            f"no {weights}: ./run trains those in models/; --weights names others, or package"
        )
    return weights


def is_synthetic(file: Path, clip: str) -> bool | None:
    """Whether a capture is generated: its record or folder says so; None if neither does.

    Parameters
    ----------
    file : a raw capture, or the Parquet file of stored clips
    clip : name of a stored clip, or of a reaction to it; empty for a raw capture
    """
    if (file.parent / _SCRIPTS).is_file():
        return True
    name = clip.partition("#")[0]
    with suppress(StoreError, OSError):
        records = read_rows(file.parent / _CLIPS, ClipRecord)
        return next((record.synthetic for record in records if record.clip == name), None)
    return None


def trained_on_line(weights: Path, *, synthetic_capture: bool | None) -> str:
    """Say what weights were trained on, and what that means for the capture they are given.

    Parameters
    ----------
    weights : file of weights
    synthetic_capture : whether the capture is generated; None if nothing says
    """
    name = str(weights)
    if (found := weights.resolve()) in (PACKAGED, PACKAGED_PRIOR):
        weights, name = found, "the model in the package"
    trained_on = read_trained_on(weights)
    if trained_on is None:
        return f"{name} does not state what it was trained on"
    text = f"{name} was trained on {trained_on}"
    if not trained_on.is_synthetic or synthetic_capture:
        return text
    if synthetic_capture is None:
        known = "on recorded partners fewer contacts are met (docs/results_recorded.md)"
        unknown = "how such weights do on recorded motion is not known"
        return f"{text}; {known if weights == PACKAGED else unknown}"
    return f"{text}; this capture is recorded: the figures of the report do not apply to it"


def package_weights(model: Path, metrics: Path, target: Path = PACKAGED) -> None:
    """Copy the weights of a finished run, and write their card beside the copy.

    Parameters
    ----------
    model : folder with ``weights.safetensors``
    metrics : ``reports/metrics.json`` of the run
    target : of the copy; the card has its name, with the suffix ``.json``

    Raises
    ------
    CommandError
        If the weights are too large for the package, or the run has no scores of their model.
    StoreError, OSError
        If a file cannot be read or written.
    """
    source = model / "weights.safetensors"
    facts, tensors = read_weights(source)
    _check_size(source, MAX_BYTES)
    rows = json.loads(metrics.read_text("utf-8")).get("pacmo", {})
    name = facts["model"]
    if name not in rows:
        raise CommandError(f"{metrics}: wanted scores of {name}; got those of {', '.join(rows)}")
    write_weights(target, facts, tensors)
    _write_card(target, _card(target, name, rows))


def package_prior(model: Path, evaluation: Path, target: Path = PACKAGED_PRIOR) -> None:
    """Copy the weights of a skeleton prior, byte by byte, with what is known of them.

    Parameters
    ----------
    model : folder with ``weights.safetensors``
    evaluation : ``reports/skeleton_prior.json`` of the run
    target : of the copy; the card has its name, with the suffix ``.json``

    Raises
    ------
    CommandError
        If the weights are too large, or the evaluation is not of them.
    StoreError, OSError
        If a file cannot be read or written.
    """
    source = model / "weights.safetensors"
    _check_size(source, MAX_PRIOR_BYTES)
    prior, content = load_skeleton_prior(source), file_hash(source)
    gains = json.loads(evaluation.read_text("utf-8"))["gain"]
    own = {
        dataset: {name: gain for name, gain in splits.items() if content in gain["weights"]}
        for dataset, splits in gains.items()
    }
    if not any(own.values()):
        raise CommandError(f"{evaluation}: wanted the evaluation of {source}; got that of others")
    target.write_bytes(source.read_bytes())
    trained_on = read_trained_on(target)
    card = {
        "model": prior.config.model,
        "trained_on": None if trained_on is None else trained_on.to_dict(),
        "licence": LICENCE,
        "sha256": content,
        "joints": list(prior.config.skeleton.joints),
        "gain": {dataset: splits for dataset, splits in own.items() if splits},
        "made_by": "python -m pacmo_core.commands.weights --prior MODEL EVALUATION.json",
    }
    _write_card(target, card)


def _check_size(weights: Path, most: int) -> None:
    size = weights.stat().st_size
    if size > most:
        raise CommandError(f"{weights}: wanted at most {most} bytes for the package; got {size}")


def _write_card(target: Path, card: dict[str, Any]) -> None:
    target.chmod(0o644)  # whoever installs the package reads it
    text = json.dumps(card, indent=2, allow_nan=False)
    write_text(target.with_suffix(".json"), f"{text}\n")


def _card(weights: Path, name: str, rows: dict[str, Any]) -> dict[str, Any]:
    model, trained_on = load_reaction_model(weights), read_trained_on(weights)
    compared = (
        "real", "oracle", "nearest_neighbour", "nearest_neighbour_finished", "regression",
        "no_noise", name,
    )  # fmt: skip
    return {
        "model": name,
        "trained_on": None if trained_on is None else trained_on.to_dict(),
        "licence": LICENCE,
        "sha256": file_hash(weights),
        "joints": list(model.skeleton.joints),
        "scores": {row: rows[row] for row in compared if row in rows},
        "limits": list(LIMITS),
        "made_by": "python -m pacmo_core.commands.weights MODEL METRICS.json",
    }


def main() -> None:
    """Copy the weights that the command line names into the package."""
    parser = argparse.ArgumentParser(description="Copy weights into the package, with their card.")
    parser.add_argument("model", type=Path, help="folder of a trained model")
    parser.add_argument("metrics", type=Path, help="METRICS.json or EVALUATION.json of the run")
    parser.add_argument("--prior", action="store_true", help="a skeleton prior, for pacmo vary")
    words = parser.parse_args()
    try:
        (package_prior if words.prior else package_weights)(words.model, words.metrics)
    except (CommandError, StoreError, OSError, ValueError) as fault:
        parser.exit(1, f"{fault}\n")


if __name__ == "__main__":
    main()
