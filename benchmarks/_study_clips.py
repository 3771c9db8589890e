"""Captured and generated clips for ``benchmarks.study``, and simple classifiers of their JSON."""

import base64
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from pacmo_core.commands.study_clips import CUTOFF_HZ, sample_items
from pacmo_core.commands.study_store import REAL, Item
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.store.motions import stream_motions, write_motions
from pacmo_core.synthesis.capture import noiseless_motion, sample_interaction, to_camera_frame
from pacmo_core.synthesis.script import ACTIONS, sample_scripts

People = Sequence[NDArray[np.floating[Any]]]  # both motions, (T, J, 3), metres
PENALTY = 1.0  # of the squared weights of the logistic regression


def write_clips(folder: Path, count: int, seed: int) -> tuple[Path, Path]:
    """Write captures, and as their reactions person b without the camera's noise.

    Returns
    -------
    the folders of the clips and of the reactions
    """
    clips, reactions = folder / "clips", folder / "reactions"
    pairs = -(-count // len(ACTIONS))
    scripts = sample_scripts(
        seed, population=seed, pairs=pairs, actions=tuple(ACTIONS), replications=1
    )
    with (
        write_motions(clips / "motions.parquet", NTU25) as captured,
        write_motions(reactions / "motions.parquet", NTU25) as generated,
    ):
        for number, (script, random) in enumerate(scripts):
            capture = sample_interaction(script, random)
            clean = noiseless_motion(script, np.random.default_rng(number), "b")
            smooth = to_camera_frame(clean, script.view).astype(np.float32)
            reaction = Interaction(NTU25, capture.times, capture.person_a, smooth)
            captured.add(f"c{number:04d}", capture)
            generated.add(f"c{number:04d}#b#0", reaction)
    return clips, reactions


def unpack(item: Item) -> People:
    """Decode both people from what the browser gets."""
    (scene,) = json.loads(item.scene)
    people = (np.frombuffer(base64.b64decode(text), "<i2") for text in scene["motions"])
    shape = (-1, len(scene["joints"]), 3)
    return [motion.reshape(shape) * scene["step"] + scene["origin"] for motion in people]


def _roughness(motion: NDArray[np.floating[Any]]) -> float:
    return float(np.linalg.norm(np.diff(motion, 3, axis=0), axis=-1).mean())


def third_difference(people: People) -> float:
    """Mean third difference of both people, in metres."""
    return float(np.mean([_roughness(motion) for motion in people]))


def third_difference_ratio(people: People) -> float:
    """Logarithm of the third difference of person b over that of person a."""
    a, b = (_roughness(motion) for motion in people)
    return float(np.log(b / a))


def bone_variation(people: People) -> float:
    """Mean standard deviation of the lengths of bones over time, in metres."""
    parent, child = NTU25.bones.T
    lengths = [np.linalg.norm(m[:, child] - m[:, parent], axis=-1) for m in people]
    return float(np.mean([bones.std(axis=0).mean() for bones in lengths]))


def speed(people: People) -> float:
    """Mean distance of a joint between frames, in metres."""
    return float(np.mean([np.linalg.norm(np.diff(m, axis=0), axis=-1).mean() for m in people]))


def lowest(people: People) -> float:
    """Height of the lowest joint of person b over that of person a, in metres."""
    a, b = (motion[..., 1].min() for motion in people)
    return float(b - a)


FEATURES: dict[str, Callable[[People], float]] = {
    "third_difference": third_difference,
    "third_difference_ratio": third_difference_ratio,
    "bone_variation": bone_variation,
    "speed": speed,
    "lowest": lowest,
}


def accuracy(values: NDArray[np.float64], labels: NDArray[np.bool_]) -> float:
    """Fit the best threshold to one half of the clips; return its accuracy in the other."""
    train = in_first_half(len(values))
    hits = [
        ((sign * values > sign * limit) == labels, (sign, limit))
        for limit in values[train]
        for sign in (1, -1)
    ]
    best, _ = max(hits, key=lambda hit: hit[0][train].mean())
    return float(best[~train].mean())


def in_first_half(count: int) -> NDArray[np.bool_]:
    """Whether each item is in the first half: both forms of a clip are in the same."""
    half: NDArray[np.bool_] = np.arange(count) % 4 < 2
    return half


def regression_accuracy(values: NDArray[np.float64], labels: NDArray[np.bool_]) -> float:
    """Fit a logistic regression on (N, F) features to one half; return its accuracy in the other.

    The features are standardised, and their squares are features too.
    """
    train = in_first_half(len(values))
    scaled = (values - values[train].mean(axis=0)) / (values[train].std(axis=0) + 1e-12)
    inputs = np.column_stack([np.ones(len(values)), scaled, scaled**2])
    signs = np.where(labels, 1.0, -1.0)

    def loss(weights: NDArray[np.float64]) -> float:
        margins = signs[train] * (inputs[train] @ weights)
        return float(np.logaddexp(0, -margins).sum() + PENALTY * weights[1:] @ weights[1:])

    weights = minimize(loss, np.zeros(inputs.shape[1])).x
    return float(((inputs[~train] @ weights > 0) == labels[~train]).mean())


def classify(clips: Path, reactions: Path, count: int, seed: int) -> dict[str, float]:
    """Return the accuracies of the classifiers, by name, with what chance allows."""
    items = list(sample_items(clips, reactions, count, np.random.default_rng(seed), CUTOFF_HZ))
    labels = np.array([item.kind == REAL for item in items])
    columns = {name: values_of(items, feature) for name, feature in FEATURES.items()}
    figures = {f"accuracy_{name}": accuracy(values, labels) for name, values in columns.items()}
    table = np.column_stack(list(columns.values()))
    figures["accuracy_regression"] = regression_accuracy(table, labels)
    figures["unblinded_third_difference"] = accuracy(*unblinded(clips, reactions))
    deviation = 3 * 0.5 / np.sqrt(count)  # half of the 2 * count items are judged
    return {**figures, "chance_low": float(0.5 - deviation), "chance_high": float(0.5 + deviation)}


def unblinded(clips: Path, reactions: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the third difference of every clip as it is, in both forms, and whether it is real."""
    pairs = zip(*(stream_motions(f / "motions.parquet") for f in (clips, reactions)), strict=True)
    motions = [motion for pair in pairs for _, motion in pair]
    values = [third_difference([m.person_a, m.person_b]) for m in motions]
    return np.array(values), np.arange(len(values)) % 2 == 0


def values_of(items: Sequence[Item], feature: Callable[[People], float]) -> NDArray[np.float64]:
    """Return a feature of every item."""
    return np.array([feature(unpack(item)) for item in items])
