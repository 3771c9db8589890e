"""A small project for the stage ``augment``: clips of two small bodies, and its parameters."""

import shutil
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from pacmo_core.augmentation.run import solve_batch
from pacmo_core.data.interaction import Interaction
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import ClipRecord, write_rows
from stages import augment
from stages.common.files import CLIPS, MOTIONS
from tests.interaction_mesh.scenes import SETTINGS

FACTS = ClipRecord(
    *("", "", "small", "", "", "", "", "arm"), 30.0, 0.4, 12, 0, "file", "ab",
    *(0.1, 2.0, 0.0, 0), False,
)  # fmt: skip
COMMAND = ["--cache=cache", "clips", "second", "variations", "metrics.json"]
PLAN = {
    "people": ["a", "b"],
    "uniform": [0.9, 1.1],
    "single": {"bones": ["upper"], "scales": [0.8, 1.2], "max_variations": 3},
    "profiles": ["long_arms"],
    "n_random": 2,
    "population": {"stature": 0.05, "proportion": 0.04, "random_seed": 3},
    "solutions": {"n": 1, "yielding": 1.5, "root": 1.0, "limbs": 0.7, "random_seed": 4},
}
SECOND = {
    "dataset": "",
    "raw": "second",
    "format": None,
    "settings": {},
    "include": ["*"],
    "drop_joints": [],
    "stated_fps": None,
    "limits": {
        "min_frames": 2,
        "max_rate_jitter": 1,
        "max_rate_error": 1,
        "max_bone_length_variation": 1,
        "max_joint_speed": 1e6,
        "max_body_speed": 1e6,
        "min_person_distance": 0,
    },
    "contact_distance": 0.1,
    "clip_seconds": 1.0,
}
LIMITS = {
    "primal_residual": 1e-2,
    "contacts_kept": 0.0,
    "capsule_penetration": 1.0,
    "knee_change_p95": 90.0,
    "elbow_change_p95": 90.0,
    "spine_change_p95": 90.0,
    "pelvis_height_error": 1.0,
    "support_height_error": 1.0,
    "spine_bend": 180.0,
    "trunk_change": 2.0,
    "below_floor": 1.0,
    "added_foot_skate": 0.1,
    "peak_acceleration_ratio": 3.0,
    "seam_ratio": 3.0,
    "knee_flips": 0.1,
    "elbow_flips": 0.1,
}


def lay_out(root: Path, clips: Mapping[str, Interaction], **changes: Any) -> None:
    """Write clips and parameters into a folder."""
    (skeleton,) = {clip.skeleton for clip in clips.values()}
    with write_motions(root / "clips" / MOTIONS, skeleton) as writer:
        for name, clip in sorted(clips.items()):
            writer.add(name, clip)
    facts = [replace(FACTS, clip=name, sequence=name) for name in sorted(clips)]
    write_rows(root / "clips" / CLIPS, ClipRecord, facts)
    (root / "second").mkdir(exist_ok=True)
    write_params(root, **changes)


def write_params(root: Path, **changes: Any) -> None:
    """Write the section, some of its keys otherwise."""
    section = {
        "clips": {
            "include": ["*"],
            "max_per_sequence": None,
            "max_clips": None,
            "near_distance": 0.25,
        },
        "second_dataset": SECOND,
        "plan": PLAN,
        "solver": asdict(SETTINGS),
        "limits": LIMITS,
        **changes,
    }
    section["solver"] = {**section["solver"], "attempts": [asdict(r) for r in SETTINGS.attempts]}
    YAML(typ="safe").dump({"augment": section}, root / "params.yaml")


def result(root: Path) -> dict[str, bytes]:
    """Read every byte that the stage made."""
    files = [path for path in (root / "variations").rglob("*") if path.is_file()]
    found = {str(path.relative_to(root)): path.read_bytes() for path in files}
    return found | {"metrics.json": (root / "metrics.json").read_bytes()}


def cached_variations(root: Path) -> dict[str, int]:
    """List the cached variations, and when each file was written."""
    files = sorted((root / "cache" / augment.VARIATION_CACHE).rglob("*.safetensors"))
    return {str(path.relative_to(root)): path.stat().st_mtime_ns for path in files}


def cached_clips(root: Path) -> list[Path]:
    """List the cached files of clips."""
    return sorted((root / "cache" / augment.CLIP_CACHE).rglob("*.safetensors"))


def spoil(path: Path) -> None:
    """Turn a bit of a file's content."""
    data = bytearray(path.read_bytes())
    data[-5] ^= 64
    path.write_bytes(data)


def solve_in_process(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Solve batches one by one in this process; count the bodies of each."""
    counts: list[int] = []

    def one_by_one(batches, *, processes):
        for batch in batches:
            counts.append(len(batch.body_keys))
            yield solve_batch(batch)

    monkeypatch.setattr(augment, "solve_with_processes", one_by_one)
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)
    return counts


def run(root: Path, monkeypatch: pytest.MonkeyPatch, *, clean: bool = False) -> dict[str, bytes]:
    """Run the stage beside what it left before, or on clean ground."""
    for folder in ("variations", "cache") if clean else ():
        shutil.rmtree(root / folder, ignore_errors=True)
    monkeypatch.chdir(root)
    names = ("cache", "clips", "second", "variations", "metrics")
    values = [Path(word.removeprefix("--cache=")) for word in COMMAND]
    augment.main(Namespace(**dict(zip(names, values, strict=True))))
    return result(root)
