"""The cases of ``benchmarks.robustness``: what writes a random file, and what reads it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks._fuzz_binary import (
    alter_parquet,
    alter_weights,
    read_archive,
    read_model,
    read_parquet,
    write_archive,
    write_mat,
    write_npy,
)
from benchmarks._fuzz_inbox import RefusedError, read_inbox, write_inbox
from benchmarks._fuzz_study import NoneTakenError, read_requests, write_requests
from benchmarks._fuzz_texts import ODD_NUMBERS, TEXTS, Grammar
from pacmo_core.commands.download import ArchiveError
from pacmo_core.data.quality import measure_quality
from pacmo_core.formats.base import FormatError, read_capture
from pacmo_core.formats.registry import DEFAULT_SETTINGS, open_format
from pacmo_core.project.workspace import one_line
from pacmo_core.store.files import StoreError

TABLES = ("motions", "clips", "quarantine", "scores", "variations")
MODELS = ("pacmo", "gru", "kinematic")
SETTINGS = {**DEFAULT_SETTINGS, "bvh": {**DEFAULT_SETTINGS["bvh"], "unit": 1.0, "up": "y"}}


@dataclass(frozen=True)
class Target:
    """One reader under test.

    Parameters
    ----------
    write : draws a file, or the files of a capture, into a folder
    read : reads them
    documented : errors that it may raise; their text is one printable line
    spoils : whether bytes of a file are changed at random too
    """

    write: Callable[[Grammar, Path], None]
    read: Callable[[Path], None]
    documented: tuple[type[Exception], ...]
    spoils: bool = True


def read_captures(name: str, folder: Path) -> None:
    """Read every capture of a folder and measure its quality, as ``ingest`` does."""
    reader = open_format(name, SETTINGS[name])
    fault: FormatError | None = None
    for sequence in reader.find(folder):
        try:
            reading = read_capture(reader, sequence)
            measure_quality(reading.interaction, contact_distance=0.1)
        except FormatError as error:
            check_message(error)
            fault = error
    if fault is not None:
        raise fault


def check_message(error: Exception) -> None:
    """Raise RuntimeError unless the text of an error is one printable line.

    Raises
    ------
    RuntimeError
        If it is not.
    """
    # Reasons of captures go into tables as they are; commands write the others by one_line.
    text = str(error) if isinstance(error, FormatError) else one_line(error)
    if not text or not text.isprintable():
        raise RuntimeError(f"the message is not one line: {text!r}")


def spoil(grammar: Grammar, data: bytes) -> bytes:
    """Cut, flip, double, lose or replace some bytes."""
    random = grammar.random
    at, stop = sorted(random.integers(0, len(data) + 1, 2).tolist())
    flipped = bytearray(data)
    for place in random.integers(0, max(len(data), 1), 8) if data else ():
        flipped[place] ^= 1 << int(random.integers(8))
    odd = ODD_NUMBERS[grammar.integer(0, len(ODD_NUMBERS))].encode()
    results = (
        *(data[:at], bytes(flipped), data[:at] + data[stop:], data[:stop] + data[at:]),
        *(data[:at] + random.bytes(16) + data[at:], data[:at] + odd + data[at:], random.bytes(64)),
    )
    return results[grammar.integer(0, len(results))]


def _template(name: str, templates: Path) -> Callable[[Grammar, Path], None]:
    suffix, alter = ("parquet", alter_parquet) if name in TABLES else ("safetensors", alter_weights)
    file = f"{name}.{suffix}"
    return lambda grammar, folder: alter(grammar, templates / file, folder / file)


def _captures(name: str) -> Callable[[Path], None]:
    return lambda folder: read_captures(name, folder)


def targets(templates: Path) -> dict[str, Target]:
    """List the readers by name.

    Parameters
    ----------
    templates : folder of ``make_templates``
    """
    found = {name: Target(w, _captures(name), (FormatError,)) for name, w in TEXTS.items()}
    found["mat"] = Target(write_mat, _captures("duetdance"), (FormatError,))
    found["npy"] = Target(write_npy, _captures("interhuman"), (FormatError,))
    for name in TABLES:
        found[name] = Target(_template(name, templates), read_parquet, (StoreError,))
    documented = (StoreError, ValueError, ArithmeticError)
    for name in MODELS:
        found[name] = Target(_template(name, templates), read_model, documented)
    found["archive"] = Target(
        lambda grammar, folder: write_archive(grammar, folder / "s01s02.zip"),
        read_archive,
        (ArchiveError,),
    )
    found["inbox"] = Target(write_inbox, read_inbox, (RefusedError,), spoils=False)
    if (templates / "study.json").exists():  # of a server that runs
        read = partial(read_requests, server=templates)
        found["study"] = Target(write_requests, read, (NoneTakenError,), spoils=False)
    return found


def run_case(target: Target, seed: tuple[int, int], folder: Path) -> bool:
    """Draw the files of one case and read them; return whether they were accepted.

    Raises
    ------
    Exception
        Whatever the reader raises that is not documented.
    """
    grammar = Grammar(np.random.default_rng(seed))
    target.write(grammar, folder)
    if target.spoils and grammar.random.random() < 0.4:
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        file = files[grammar.integer(0, len(files))]
        file.write_bytes(spoil(grammar, file.read_bytes()))
    try:
        target.read(folder)
    except target.documented as error:
        check_message(error)
        return False
    return True
