"""A folder of clips and parameters in which a training stage runs in seconds."""

from dataclasses import asdict, replace
from pathlib import Path

from ruamel.yaml import YAML

from pacmo_core.data.skeleton import SBU15
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import ClipRecord, SplitRecord, write_rows
from tests.reaction.problems import AUTOENCODER, FLOW_MATCHING, GRU, PACMO, REGRESSION, clips

FACTS = ClipRecord(
    clip="", sequence="", dataset="toy", action="follow", subject_a="", subject_b="",
    recording="", skeleton="sbu15", fps=15.0, duration=1.0, frames=20, start_frame=0,
    source_file="", sha256="", bone_length_variation=0.0, max_joint_speed=0.0,
    contact_share=0.0, filled_frames=0, synthetic=True,
)  # fmt: skip
SECTIONS = {
    "train_autoencoder": replace(AUTOENCODER, n_epochs=6),
    "train_flow_matching": replace(FLOW_MATCHING, n_epochs=6),
    "train_gru": replace(GRU, n_epochs=6),
    "train_pacmo": replace(PACMO, n_epochs=6),
    "train_regression": replace(REGRESSION, n_epochs=6),
}
SEEDED = ("train_flow_matching", "train_gru", "train_pacmo", "train_regression")


def plain(values: object) -> object:
    """Turn tuples into lists, which YAML knows."""
    if isinstance(values, dict):
        return {key: plain(value) for key, value in values.items()}
    return [plain(value) for value in values] if isinstance(values, list | tuple) else values


def prepare(folder: Path) -> None:
    """Write ``clips/``, ``splits.parquet`` and ``params.yaml``."""
    rows, splits = [], []
    with write_motions(folder / "clips/motions.parquet", SBU15) as writer:
        for number, clip in enumerate(clips(10)):
            name = f"clip{number:02d}"
            splits.append(SplitRecord(name, "validation" if number < 2 else "train"))
            writer.add(name, clip)
            rows.append(replace(FACTS, clip=name, sequence=name))
    write_rows(folder / "clips/clips.parquet", ClipRecord, rows)
    write_rows(folder / "splits.parquet", SplitRecord, splits)
    params = {name: {**plain(asdict(section)), "threads": 1} for name, section in SECTIONS.items()}
    for section in SEEDED:
        del params[section]["random_seed"]  # comes from the command line
    YAML(typ="safe").dump(params, folder / "params.yaml")
