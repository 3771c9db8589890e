"""Settings of the start of the kinematic skeleton prior, chosen on training variations.

Usage: python -m benchmarks.start_settings [--json] [--dataset D] [--splits S ...]

Coordinate descent: each setting of ``train_skeleton_prior.start`` in turn is tried at the values of
a grid, and the value of the lowest E_r on the variations that every split trains on is kept, until
no change helps. No variation that any of the splits validates or tests on is read. Prints the
settings and their E_r before and after, in millimetres.
"""

from dataclasses import asdict, replace
from pathlib import Path

import torch
from ruamel.yaml import YAML

from benchmarks._figures import arguments, show
from pacmo_core.models import build_skeleton_prior
from pacmo_core.skeleton_prior import training
from pacmo_core.skeleton_prior.data import Example, ExampleDataset, encode_examples
from pacmo_core.skeleton_prior.kinematics import find_limbs
from pacmo_core.skeleton_prior.layers import initialise_weights
from pacmo_core.skeleton_prior.settings import PriorConfig, StartSettings
from stages.common.examples import stream_examples

STRIDE = 6  # frames between those that are compared
MIN_GAIN = 0.02e-3  # metres
GRID = {
    "ground_height": (0.03, 0.05, 0.08, 0.12, 0.2, 0.3),
    "contact_range": (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6),
    "root": (0.1, 0.3, 1.0, 3.0, 10.0),
    "ground": (10.0, 30.0, 100.0, 300.0),
    "contact": (0.0, 0.03, 0.1, 0.3, 1.0, 3.0),
    "foot": (0.0, 0.3, 1.0, 3.0, 10.0, 30.0),
    "hand": (0.0, 0.3, 1.0, 3.0, 10.0),
    "yielding": (0.0, 0.15, 0.25, 0.35, 0.5, 0.7, 1.0),
}


def main() -> None:
    """Search and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--dataset", default="default", help="a folder of data/variations")
    parser.add_argument("--splits", nargs="+", default=["random", "cross_interaction"])
    options = parser.parse_args()
    torch.set_num_threads(1)
    variations, folder = (
        Path("data", kind, options.dataset) for kind in ("variations", "priors/splits")
    )
    trained_on = [
        dict(stream_examples(variations, folder / f"{split}.parquet", "train"))
        for split in options.splits
    ]
    common = set.intersection(*(set(examples) for examples in trained_on))
    examples = [example for name, example in trained_on[0].items() if name in common]
    section = YAML(typ="safe").load(Path("params.yaml").read_text())["train_skeleton_prior"]
    settings = StartSettings(**section["start"])
    before = error(settings, examples)
    settings, after = search(settings, examples)
    figures = {
        "variations": len(examples),
        "before_mm": 1e3 * before,
        "after_mm": 1e3 * after,
    } | asdict(settings)
    show(figures, as_json=options.json)


def search(settings: StartSettings, examples: list[Example]) -> tuple[StartSettings, float]:
    """Descend by coordinates over ``GRID``; return the settings and their error, metres."""
    data = encode_examples(examples)
    best = error(settings, examples, data)
    improved = True
    while improved:
        improved = False
        for name, values in GRID.items():
            for value in values:
                changed = replace(settings, **{name: value})
                score = error(changed, examples, data)
                if score < best - MIN_GAIN:
                    settings, best, improved = changed, score, True
    return settings, best


def error(
    settings: StartSettings, examples: list[Example], data: ExampleDataset | None = None
) -> float:
    """Return the mean position error of the untrained start, metres."""
    template = examples[0].template
    limbs = find_limbs(template.skeleton, template.person_a)
    config = PriorConfig(template.skeleton, limbs, "kinematic", 16, STRIDE, template.fps, settings)
    model = build_skeleton_prior(config).eval()
    initialise_weights(model, torch.Generator().manual_seed(0))
    with torch.no_grad():
        return float(training.mean_position_error(model, data or encode_examples(examples)))


if __name__ == "__main__":
    main()
