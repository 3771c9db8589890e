"""Crafted files that ``benchmarks.robustness`` wants refused: each has one fault."""

import io
import json
import os
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from safetensors.torch import save_file
from scipy.io import savemat

from benchmarks._fuzz_binary import read_archive
from benchmarks._fuzz_cases import SETTINGS, read_captures
from benchmarks._fuzz_inbox import (
    IRREGULAR,
    RefusedError,
    read_inbox,
    unix_socket,
    write_irregular,
)
from pacmo_core.commands.download import ArchiveError
from pacmo_core.formats.base import FormatError, RawSequence
from pacmo_core.formats.registry import open_format
from pacmo_core.models import load_reaction_model
from pacmo_core.store.files import StoreError
from pacmo_core.store.motions import MotionReader, stream_motions
from pacmo_core.store.weights import read_weights

Write = Callable[[Path, Path], None]  # folder, templates
Alter = Callable[[pa.Table], pa.Table]
AlterWeights = Callable[[dict[str, Any], dict[str, torch.Tensor]], Any]


@dataclass(frozen=True)
class Crafted:
    """A file that must be refused.

    Parameters
    ----------
    write : into a folder, from the templates
    read : the folder
    documented : the errors that refuse it
    """

    write: Write
    read: Callable[[Path], None]
    documented: tuple[type[Exception], ...]

    def run(self, folder: Path, templates: Path) -> None:
        """Write and read it."""
        self.write(folder, templates)
        self.read(folder)


BVH = (
    "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\nJOINT b\n{\n"
    "OFFSET 0 1 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n}\n}\n"
    "MOTION\nFrames: 2\nFrame Time: 0.04\n1 2 3 4 5 6\n1 2 3 4 5 7\n"
)
SBU_ROW = ",".join(["0.5"] * 90)
NTU = "2\n" + ("2\n" + "".join(
    f"{body} 0 0 0 0 0 0 0 0 0\n25\n" + f"0.{body} 0.2 3 0 0 0 0 0 0 0 0 2\n" * 25
    for body in (1, 2)
)) * 2  # fmt: skip
FILES = {
    "bvh": ("x_A.bvh", "x_B.bvh"),
    "sbu": ("skeleton_pos.txt",),
    "ntu": ("x.skeleton",),
    "duetdance": ("male/1/1/skeleton_pos.txt", "female/1/1/skeleton_pos.txt"),
    "expi": ("acro1/a1/mocap_cleaned.tsv",),
    "interhuman": ("person1/7.npy", "person2/7.npy"),
    "cmu": ("18/18.asf", "18/18_01.amc", "19/19.asf", "19/19_01.amc"),
}
# Format, valid text, and what is replaced by what.
EDITS: tuple[tuple[str, str, str, str, str], ...] = (
    ("bvh", "two roots", BVH, "JOINT b", "ROOT b"),
    ("bvh", "no offset", BVH, "OFFSET 0 1 0\n", ""),
    ("bvh", "one name twice", BVH, "JOINT b", "JOINT a"),
    ("bvh", "open brace", BVH, "}\n}\n", "}\n"),
    ("bvh", "more frames", BVH, "Frames: 2", "Frames: 3"),
    ("bvh", "frame time 0", BVH, "0.04", "0"),
    ("bvh", "channels", BVH, "CHANNELS 3 Z", "CHANNELS 2 Z"),
    ("bvh", "channel twice", BVH, "Xposition Y", "Yposition Y"),
    ("bvh", "nan", BVH, "7", "nan"),
    ("bvh", "infinity", BVH, "7", "1e999"),
    ("bvh", "underscore", BVH, "7", "7_0"),
    ("bvh", "Arabic digit", BVH, "7", "٧"),
    ("bvh", "Arabic digit in an offset", BVH, "OFFSET 0 1", "OFFSET 0 ١"),
    ("bvh", "full-width digit in the frame time", BVH, "0.04", "０.04"),
    ("bvh", "row too short", BVH, " 7", ""),
    ("bvh", "a kilometre away", BVH, "1 2 3 4 5 7", "9999 2 3 4 5 7"),
    ("sbu", "Arabic digit", f"1,{SBU_ROW}\n2,{SBU_ROW}\n", "2,", "٢,"),
    ("sbu", "frame missing", f"1,{SBU_ROW}\n2,{SBU_ROW}\n", "2,", "3,"),
    ("sbu", "91 fields", f"1,{SBU_ROW}\n2,{SBU_ROW}\n", "2,0.5,", "2,"),
    ("sbu", "nan", f"1,{SBU_ROW}\n2,{SBU_ROW}\n", "2,0.5,", "2,nan,"),
    ("ntu", "joint count", NTU, "25\n", "24\n"),
    ("ntu", "frames", NTU, NTU, f"3{NTU[1:]}"),
    ("ntu", "Arabic digit", NTU, "25\n", "٢٥\n"),
    ("ntu", "one body twice", NTU, "2 0 0 0", "1 0 0 0"),
    ("duetdance", "Arabic digit", f"1,{SBU_ROW[:179]}\n2,{SBU_ROW[:179]}\n", "2,0.5", "2,٥"),
    ("duetdance", "short row", f"1,{SBU_ROW[:179]}\n2,{SBU_ROW[:179]}\n", "2,0.5", "2"),
)


def _read_named(name: str, folder: Path) -> None:
    """Read files that are named, not found: as a command reads its arguments."""
    files = tuple(folder / file for file in FILES[name])
    open_format(name, SETTINGS[name]).read(RawSequence("7", files))


def _write_text(name: str, text: str, folder: Path, _: Path) -> None:
    for file in FILES[name]:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(text, encoding="utf-8")


def _special(name: str, make: Callable[[Path], None], folder: Path, _: Path) -> None:
    for file in FILES[name]:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        make(folder / file)


def sparse(path: Path) -> None:
    """Make a file of 2 GB without content."""
    with path.open("wb") as file:
        file.truncate(2 << 30)


SPECIAL: dict[str, Callable[[Path], None]] = {
    "2 GB": sparse,
    "a named pipe": os.mkfifo,
    "a socket": unix_socket,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "a link to nothing": lambda path: path.symlink_to("nothing"),
}


def _large_bvh(folder: Path, templates: Path) -> None:
    """Write 60,000 frames of one channel and 900 joints: 200 KB that would take minutes."""
    joints = "".join(f"JOINT j{i}\n{{\nOFFSET 0 0 0\nCHANNELS 0\n" for i in range(900))
    head = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 1 Xposition\n"
    tree = head + joints + "}" * 901
    text = f"{tree}\nMOTION\nFrames: 60000\nFrame Time: 0.04\n" + "1\n" * 60_000
    _write_text("bvh", text, folder, templates)


def _many_variables(folder: Path, _: Path) -> None:
    for sex in ("male", "female"):
        (folder / sex).mkdir()
        values = {f"v{i}_1": np.zeros((1, 1)) for i in range(5000)}
        savemat(folder / sex / "salsa.mat", values)


def _set(table: pa.Table, name: str, values: Any, kind: pa.DataType | None = None) -> pa.Table:
    index = table.column_names.index(name)
    return table.set_column(index, name, pa.array(values, kind or table.schema.field(name).type))


def _ragged(table: pa.Table) -> pa.Table:
    """Move a joint from one pose to the next: the total is that of a valid file."""
    poses = table["person_a"].to_pylist()
    poses[0], poses[1] = poses[0][:-1], [*poses[1], poses[0][-1]]
    return _set(table, "person_a", poses, pa.list_(pa.list_(pa.float32(), 3)))


def _late(table: pa.Table) -> pa.Table:
    times = table["time"].to_numpy().copy()
    times[5:12] += 86_400
    return _set(table, "time", times)


def _null_pose(table: pa.Table) -> pa.Table:
    poses = table["person_a"].to_pylist()
    poses[3] = None
    return _set(table, "person_a", poses)


TABLES: dict[str, Alter] = {
    "ragged poses": _ragged,
    "a missing pose": _null_pose,
    "frames a day apart": _late,
    "times as text": lambda t: _set(
        t, "time", [str(x) for x in t["time"].to_pylist()], pa.string()
    ),
    "clips as numbers": lambda t: _set(t, "clip", range(len(t)), pa.int64()),
    "poses in float64": lambda t: _set(
        t,
        "person_a",
        t["person_a"].to_pylist(),
        pa.list_(pa.list_(pa.float64(), 3), t.schema.field("person_a").type.list_size),
    ),
    "no column of times": lambda t: t.drop_columns(["time"]),
    "one column more": lambda t: t.append_column("more", pa.array(range(len(t)))),
    "no skeleton": lambda t: t.replace_schema_metadata({"pacmo": "1"}),
    "another version": lambda t: t.replace_schema_metadata({**t.schema.metadata, b"pacmo": b"9"}),
    "a skeleton of numbers": lambda t: t.replace_schema_metadata(
        {b"pacmo": b"1", b"skeleton": b'{"name":1,"joints":[1],"parents":[-1],"left_right":[]}'}
    ),
    "clips in descending order": lambda t: t.take(np.arange(len(t))[::-1]),
    "frames that are missing": lambda t: t.slice(3),
}


def _write_table(alter: Alter, folder: Path, templates: Path) -> None:
    table = alter(pq.read_table(templates / "motions.parquet"))
    pq.write_table(table, folder / "motions.parquet", row_group_size=7, write_statistics=False)


def _read_motions(folder: Path) -> None:
    names = [name for name, _ in stream_motions(folder / "motions.parquet")]
    MotionReader(folder / "motions.parquet").read(names[0])


def _write_weights(alter: AlterWeights, folder: Path, templates: Path) -> None:
    config, state = read_weights(templates / "pacmo.safetensors")
    facts = alter(config, state)
    save_file(state, folder / "w.safetensors", metadata={"config": json.dumps(facts)})


def _edit(config: dict[str, Any], *keys: str, value: Any) -> dict[str, Any]:
    if not keys:
        return value  # type: ignore[no-any-return]
    return {**config, keys[0]: _edit(config[keys[0]], *keys[1:], value=value)}


def _tensor(change: Callable[[torch.Tensor], torch.Tensor]) -> AlterWeights:
    """Change the first tensor with more than one axis, and not the configuration."""

    def alter(config: dict[str, Any], state: dict[str, torch.Tensor]) -> dict[str, Any]:
        name = min(name for name in state if state[name].ndim > 1)
        state[name] = change(state[name]).contiguous()
        return config

    return alter


def _special_file(name: str, make: Callable[[Path], None]) -> Write:
    return lambda folder, _: make(folder / name)


WEIGHTS: dict[str, AlterWeights] = {
    "a list": lambda *_: [],
    "null": lambda *_: None,
    "no model": lambda c, _: {"config": c["config"]},
    "a configuration that is null": lambda c, _: {**c, "config": None},
    "a missing tensor": lambda c, s: (s.pop(min(s)), c)[1],
    "a tensor more": lambda c, s: (s.update(more=torch.zeros(1)), c)[1],
    "a tensor of another shape": _tensor(lambda t: t[:-1]),
    "a tensor that is not a number": _tensor(lambda t: t * np.nan),
    "a tensor of whole numbers": _tensor(lambda t: t.int()),
    "a period that is not a number": lambda c, _: _edit(
        c, "config", "uno", "period", value=float("nan")
    ),
    "a million points": lambda c, _: _edit(c, "config", "uno", "n_points", value=10**6 + 1),
    "a million channels": lambda c, _: _edit(c, "config", "uno", "lifting", value=10**6),
    "labels that are numbers": lambda c, _: _edit(c, "config", "actions", value=[1, 2]),
}


def _write_archive(
    names: tuple[str, ...],
    folder: Path,
    _: Path,
    *,
    method: int = 0,
    flag: int = 0,
    size: int = -1,
    encoded: tuple[bytes, bytes] = (b"", b""),
) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as archive:
        for name in names:
            archive.writestr(name, b"1,2,3\n" * 1000)
    data = bytearray(packed.getvalue())
    central = data.find(b"PK\x01\x02")
    data[central + 8] |= flag
    if size >= 0:
        data[central + 24 : central + 28] = size.to_bytes(4, "little")
    (folder / "s01s02.zip").write_bytes(bytes(data).replace(*encoded) if encoded[0] else data)


TAKE = "s01s02/01/001/skeleton_pos.txt"
ARCHIVES: dict[str, Write] = {
    "encrypted": partial(_write_archive, (TAKE,), flag=1),
    "leads out of the folder": partial(_write_archive, (f"../../{TAKE}",)),
    "absolute": partial(_write_archive, (f"/tmp/{TAKE}",)),
    "a drive": partial(_write_archive, (f"C:{TAKE}",)),
    "a take twice": partial(_write_archive, (TAKE, f"x/{TAKE}")),
    "bzip2": partial(_write_archive, (TAKE,), method=zipfile.ZIP_BZIP2),
    "a size too small": partial(_write_archive, (TAKE,), method=zipfile.ZIP_DEFLATED, size=10),
    "a size too large": partial(_write_archive, (TAKE,), method=zipfile.ZIP_DEFLATED, size=1 << 30),
    "no take": partial(_write_archive, ("readme.txt",)),
    "not UTF-8": partial(_write_archive, (f"é/{TAKE}",), encoded=("é".encode(), b"\xff\xff")),
}


def crafted_cases() -> dict[str, Crafted]:
    """List the cases by name."""
    cases: dict[str, Crafted] = {}
    for name in FILES:
        read = partial(_read_named, name)
        for what, make in SPECIAL.items():
            cases[f"{name}: {what}"] = Crafted(partial(_special, name, make), read, (FormatError,))
    for name, what, text, old, new in EDITS:
        edited = text[::-1].replace(old[::-1], new[::-1], 1)[::-1]  # the last occurrence
        write = partial(_write_text, name, edited)
        cases[f"{name}: {what}"] = Crafted(write, partial(read_captures, name), (FormatError,))
    duetdance = partial(read_captures, "duetdance")
    cases["bvh: 900 joints"] = Crafted(_large_bvh, partial(read_captures, "bvh"), (FormatError,))
    cases["mat: 5000 variables"] = Crafted(_many_variables, duetdance, (FormatError,))
    for what, alter in TABLES.items():
        cases[f"motions: {what}"] = Crafted(
            partial(_write_table, alter), _read_motions, (StoreError,)
        )
    for what, change in WEIGHTS.items():
        write = partial(_write_weights, change)
        cases[f"weights: {what}"] = Crafted(write, _read_weights, (StoreError,))
    for what, pack in ARCHIVES.items():
        cases[f"archive: {what}"] = Crafted(pack, read_archive, (ArchiveError,))
    return cases | _irregular_cases()


def _irregular_cases() -> dict[str, Crafted]:
    """List what is no regular file, for readers that are given a path and for the inbox."""
    cases: dict[str, Crafted] = {}
    for what, make in SPECIAL.items():
        cases[f"motions: {what}"] = Crafted(
            _special_file("motions.parquet", make),
            _read_motions,
            (StoreError, FileNotFoundError),
        )
        cases[f"weights: {what}"] = Crafted(
            _special_file("w.safetensors", make),
            _read_weights,
            (StoreError, FileNotFoundError),
        )
    for what, irregular in IRREGULAR.items():
        cases[f"inbox: {what}"] = Crafted(
            partial(write_irregular, irregular), read_inbox, (RefusedError,)
        )
    return cases


def _read_weights(folder: Path) -> None:
    load_reaction_model(folder / "w.safetensors")
