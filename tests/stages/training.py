"""A folder of clips and parameters in which a training stage runs in seconds."""

from dataclasses import asdict, replace
from pathlib import Path

from ruamel.yaml import YAML

from pacmo_core.skeleton import SBU15
from pacmo_core.store.clips import ClipFacts, write_rows
from pacmo_core.store.motions import write_motions
from tests.pacmo.problems import AUTOENCODER, GRU, PACMO, clips

FACTS = ClipFacts(
    clip="", sequence="", dataset="toy", action="follow", subject_a="", subject_b="",
    recording="", skeleton="sbu15", fps=15.0, duration=1.0, frames=20, start_frame=0,
    source_file="", sha256="", bone_length_variation=0.0, max_joint_speed=0.0,
    contact_share=0.0, filled_frames=0,
)  # fmt: skip
SECTIONS = {
    "train_autoencoder": replace(AUTOENCODER, n_epochs=6),
    "train_gru": replace(GRU, n_epochs=6),
    "train_pacmo": replace(PACMO, n_epochs=6),
}


def prepare(folder: Path) -> None:
    """Write ``clips/`` and ``params.yaml``."""
    rows = []
    with write_motions(folder / "clips/motions.parquet", SBU15) as writer:
        for number, clip in enumerate(clips(10)):
            name = f"clip{number:02d}"
            side = "validation" if number < 2 else "train"
            writer.add(name, clip)
            rows.append(replace(FACTS, clip=name, sequence=name, side=side))
    write_rows(folder / "clips/clips.parquet", ClipFacts, rows)
    params = {name: {**asdict(section), "threads": 1} for name, section in SECTIONS.items()}
    YAML(typ="safe").dump(params, folder / "params.yaml")
