"""Give clips other bodies, and put aside what is not good enough to train on.

Usage: python -m stages.augment --cache=DIR CLIPS SECOND VARIATIONS METRICS.json

SECOND is a folder of captures of another skeleton, whose family is written beside. DIR caches
variations and files of clips across runs (DVC does not manage it): only what is new is computed,
and the result is the same bytes as without it. DASK_SCHEDULER_ADDRESS names a cluster to compute
on.
"""

import argparse
import logging
import shutil
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from pacmo_core.augmentation.clip_files import settings_key
from pacmo_core.augmentation.filter import VariationLimits, exceeded_limits
from pacmo_core.augmentation.plan import Plan
from pacmo_core.augmentation.run import solver_key
from pacmo_core.interaction_mesh import Settings
from pacmo_core.store.cache import Cache
from pacmo_core.store.tables import VariationRecord
from stages._files import write_json
from stages._params import read_params
from stages._sources import Choice, SecondDataset, own_family, second_family
from stages._variations import Making, write_family

# Folders of the cache.
VARIATIONS, CLIPS = "variations", "clips"
USUAL = (5, 95)  # percentiles of the figures between which most variations lie


@dataclass(frozen=True)
class Params:
    """The ``augment`` section of ``params.yaml``."""

    clips: Choice  # which are varied
    second_dataset: SecondDataset  # varied beside the experiment's dataset
    plan: Plan  # the bodies that each is given
    solver: Settings
    limits: VariationLimits  # of a variation that is accepted for training


def main(paths: argparse.Namespace) -> None:
    params = read_params("augment", Params)
    solver = solver_key(params.solver)
    variations = Cache(paths.cache / VARIATIONS, solver)
    clips = Cache(paths.cache / CLIPS, settings_key(solver, params.plan, params.limits))
    making = Making(params.plan, params.solver, params.limits, variations, clips)
    families = [
        own_family(paths.clips, params.clips),
        *second_family(params.second_dataset, paths.second, params.clips),
    ]
    if paths.variations.exists():
        # As DVC does before it runs a stage: clips that are gone, and what a killed run left, go.
        shutil.rmtree(paths.variations)
    metrics = {}
    for family in families:
        rows = write_family(paths.variations / family.name, family, making)
        metrics[family.name] = summary(rows, params.limits)
    variations.remove_other_namespaces()
    clips.remove_other_namespaces()
    clips.remove_unused()
    write_json(paths.metrics, metrics)


def summary(rows: Sequence[VariationRecord], limits: VariationLimits) -> dict[str, object]:
    """Say how many there are, why some are put aside, and how good they are by kind."""
    refused = [row for row in rows if not row.accepted and not row.measurements]
    failed = [row for row in rows if not row.accepted and row.measurements]
    reasons = Counter(name for row in failed for name in exceeded_limits(row.measurements, limits))
    kinds = sorted({row.kind for row in rows if row.measurements})
    return {
        "clips": len({row.clip for row in rows}),
        "planned": len(rows),
        "accepted": sum(row.accepted for row in rows),
        "failed": len(failed),
        "refused": len(refused),
        "failed_by": dict(sorted(reasons.items())),
        "refused_clips": sorted({row.clip for row in refused}),
        "kinds": {kind: figures([row for row in rows if row.kind == kind]) for kind in kinds},
    }


def figures(rows: Sequence[VariationRecord]) -> dict[str, dict[str, float]]:
    """Give each figure's mean over variations, and between which values most of them lie."""
    found = {}
    for name in sorted({name for row in rows for name in row.measurements}):
        values = [row.measurements[name] for row in rows if name in row.measurements]
        values = [value for value in values if isfinite(value)]
        if values:
            low, high = np.percentile(values, USUAL)
            found[name] = {"mean": float(np.mean(values)), "low": float(low), "high": float(high)}
    return found


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--cache", type=Path, required=True, help="folder of what was computed before"
    )
    for name in ("clips", "second", "variations", "metrics"):
        parser.add_argument(name, type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    main(arguments())
