"""Trusted as truth: whatever a file holds, a reader gives a reading or says what is wrong."""

import faulthandler
from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.data.quality import limit_violations, measure_quality
from pacmo_core.formats.base import FormatError, Reading
from pacmo_core.formats.registry import FORMATS, open_format
from pacmo_core.formats.write_ntu import format_frames
from tests.formats.mutations import MUTATIONS, mutate
from tests.formats.valid_sets import (
    write_bvh_pair,
    write_cmu,
    write_duetdance,
    write_expi,
    write_interhuman,
    write_tables,
)
from tests.strategies import LIMITS

N_FILES = 2000
# Seconds that no file of a few kilobytes can need: past it a reader hangs, and the run is ended.
HANG = 20
SHORT = replace(LIMITS, min_frames=2)  # the written sets have a handful of frames


def write_ntu(folder):
    a, b = np.random.default_rng(0).normal([0, 0, 3], 0.2, size=(2, 25, 3))
    shown = [
        {72057594037932185: a + np.array([t, 0, 0]), 72057594037932127: b + np.array([1, 0, t])}
        for t in np.arange(4) / 100
    ]
    (folder / "S001C001P001R001A050.skeleton").write_bytes(format_frames(shown))


def write_sbu(folder):
    values = np.random.default_rng(0).random((5, 90)).round(5).tolist()
    rows = [",".join(map(str, [10 + t, *row])) for t, row in enumerate(values)]
    take = folder / "s01s02" / "01" / "001"
    take.mkdir(parents=True)
    (take / "skeleton_pos.txt").write_text("\r\n".join(rows) + "\r\n")


BVH = {
    "preset": "pair",
    "unit": 1.0,
    "up": "y",
    "fps": None,
    "end_sites": False,
    "skip_frames": 0,
    "max_root_distance": None,
}

# Name, settings, and what writes a small valid set into a folder.
READERS = [
    (
        "ntu",
        {"fps": 30.0, "max_gap": 5, "max_link_distance": 0.3, "min_visible_share": 0.5},
        write_ntu,
    ),
    ("sbu", {"fps": 15.0}, write_sbu),
    ("duetdance", {"fps": 25.0}, write_duetdance),
    ("expi", {"fps": 25.0, "up": "z"}, write_expi),
    ("bvh", BVH, write_bvh_pair),
    ("cmu", {"fps": {"18": 120.0, "19": 120.0}}, write_cmu),
    ("interhuman", {"fps": 30.0, "up": "z"}, write_interhuman),
    ("table", {}, write_tables),
]


@pytest.fixture
def watchdog():
    yield lambda: faulthandler.dump_traceback_later(HANG, exit=True)
    faulthandler.cancel_dump_traceback_later()


def outcome(reader, root):
    """Read all there is: how many readings, after each of which quality can be measured."""
    n_readings = 0
    reasons = []
    for sequence in reader.find(root):
        try:
            reading = reader.read(sequence)
        except FormatError as error:
            reasons.append(error)
            continue
        assert isinstance(reading, Reading)
        limit_violations(measure_quality(reading.interaction, contact_distance=0.1), SHORT)
        n_readings += 1
    assert all(str(root) in str(error) and error.reason.isprintable() for error in reasons)
    return n_readings


def test_every_format_is_spoilt():
    assert [name for name, _, _ in READERS] == list(FORMATS)


@pytest.mark.parametrize(("name", "settings", "write"), READERS, ids=[row[0] for row in READERS])
def test_the_unspoilt_set_is_read(tmp_path, name, settings, write):
    write(tmp_path)
    assert outcome(open_format(name, settings), tmp_path) >= 1


@pytest.mark.parametrize(("name", "settings", "write"), READERS, ids=[row[0] for row in READERS])
@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.__name__)
def test_one_fault_of_each_kind_is_survived(tmp_path, name, settings, write, mutation):
    spoil(tmp_path, write, mutation, seed=1)
    outcome(open_format(name, settings), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "settings", "write"), READERS, ids=[row[0] for row in READERS])
def test_thousands_of_spoilt_files_end_in_a_reading_or_a_reason(
    tmp_path, watchdog, name, settings, write
):
    reader = open_format(name, settings)
    per_reader = -(-N_FILES // len(READERS))
    write(tmp_path)
    originals = {p: p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()}
    generator = np.random.default_rng(0)
    n_readings = 0
    for i in range(per_reader):
        path = list(originals)[i % len(originals)]
        path.write_bytes(mutate(originals[path], generator))
        watchdog()
        n_readings += outcome(reader, tmp_path)
        path.write_bytes(originals[path])
    # Both ends occur: the mutator is neither too gentle nor too rough to try the reader.
    assert 0 < n_readings < per_reader * len(originals)


def spoil(folder, write, mutation, seed):
    write(folder)
    generator = np.random.default_rng(seed)
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        path.write_bytes(mutation(path.read_bytes(), generator))
