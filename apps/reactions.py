"""Reactions in files: Parquet of the store, or BVH, a file a person a sample."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from apps.duos import is_parquet
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.project.workspace import CommandError
from pacmo_core.store.files import write_text
from pacmo_core.store.motions import write_motions


@dataclass(frozen=True)
class Reactions:
    """Reactions to one partner.

    Parameters
    ----------
    name : of the partner's capture
    skeleton : of both
    times : (T,) float64, seconds
    partner : (T, J, 3) float32, metres
    samples : (S, T, J, 3) float32, metres
    """

    name: str
    skeleton: Skeleton
    times: NDArray[np.float64]
    partner: Motion
    samples: Motion


def check_out(out: Path) -> None:
    """Refuse a place that says no format, before any work is done."""
    if out.suffix.lower() not in (".parquet", ".bvh", "") and not out.is_dir():
        raise CommandError(f"{out}: wanted a .parquet or .bvh file, or a folder for BVH files")


def write(reactions: Reactions, out: Path) -> list[Path]:
    """Write each file whole or not at all; list them."""
    if is_parquet(out):
        with write_motions(out, reactions.skeleton) as writer:
            for number, reaction in enumerate(reactions.samples):
                pair = Interaction(reactions.skeleton, reactions.times, reactions.partner, reaction)
                writer.add(f"{reactions.name}#{number:04d}", pair)
        return [out]
    folder, stem = (
        (out, reactions.name) if not out.suffix or out.is_dir() else (out.parent, out.stem)
    )
    return _write_bvh(reactions, folder, stem)


def _write_bvh(reactions: Reactions, folder: Path, stem: str) -> list[Path]:
    """Name files so that the preset ``pair`` finds the two people of each sample."""
    fps = float(1 / np.median(np.diff(reactions.times)))
    partner = format_bvh(reactions.partner, fps, reactions.skeleton)
    files = []
    for number, reaction in enumerate(reactions.samples):
        text = format_bvh(reaction, fps, reactions.skeleton)
        for person, content in (("A", partner), ("B", text)):
            files.append(folder / f"{stem}_{number}_{person}.bvh")
            write_text(files[-1], content)
    return files
