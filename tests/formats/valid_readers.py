"""Every reader of files with two people, with a writer of a small valid set for it."""

from collections.abc import Callable
from pathlib import Path

from pacmo_core.formats.base import Format
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.cmu import CMU_FPS, Cmu
from pacmo_core.formats.duetdance import DuetDance
from pacmo_core.formats.expi import Expi
from pacmo_core.formats.interhuman import InterHuman
from pacmo_core.formats.table import Table
from tests.formats.valid_sets import (
    write_bvh_pair,
    write_cmu,
    write_duetdance,
    write_duetdance_text,
    write_expi,
    write_interhuman,
    write_tables,
)

# Each writer with a reader whose settings fit what it writes.
VALID_SETS: dict[str, tuple[Callable[[Path], None], Format]] = {
    "bvh_pairs": (
        write_bvh_pair,
        BvhPairs(
            preset="pair",
            unit=1.0,
            up="y",
            fps=None,
            end_sites=True,
            skip_frames=0,
            max_root_distance=None,
        ),
    ),
    "cmu": (write_cmu, Cmu(fps=CMU_FPS)),
    "duetdance": (write_duetdance, DuetDance(fps=25.0)),
    "duetdance_text": (write_duetdance_text, DuetDance(fps=25.0)),
    "expi": (write_expi, Expi(fps=25.0, up="y")),
    "table": (write_tables, Table()),
    "interhuman": (write_interhuman, InterHuman(fps=30.0, up="y")),
}
