"""Random binary files for ``benchmarks.robustness``: arrays, Parquet, weights and archives.

Each is a valid file that is altered in its own terms (another type, a missing tensor, an encrypted
member), and the readers that take it.
"""

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from safetensors.torch import save_file
from scipy.io import savemat

from benchmarks._fuzz_texts import Grammar
from pacmo_core.api import save, synthesise, train
from pacmo_core.commands.download import extract_skeletons
from pacmo_core.models import build_skeleton_prior, load_model, load_reaction_model
from pacmo_core.reaction.inference import react
from pacmo_core.reaction.windows import is_deterministic
from pacmo_core.skeleton_prior.kinematics import find_limbs
from pacmo_core.skeleton_prior.settings import PriorConfig, StartSettings
from pacmo_core.store.motions import MotionReader, read_skeleton, stream_motions, write_motions
from pacmo_core.store.scores import Score, read_scores, write_scores
from pacmo_core.store.tables import (
    ClipRecord,
    QuarantineRecord,
    VariationRecord,
    read_rows,
    read_variations,
    write_rows,
    write_variations,
)
from pacmo_core.store.weights import read_weights, write_weights
from pacmo_core.training.state import model_config, model_state

ODD_VALUES: tuple[Any, ...] = (
    *(None, [], {}, "", "x", -1, 0, 1, 1.5, 10**6, 10**30, 1e300, True, [[[]]]),
    *(float("nan"), float("inf"), "\x1b[31m", ["a", 1], "../../x", -1e-300),
)
Alteration = Callable[[Grammar, pa.Table], pa.Table]


def make_templates(folder: Path) -> None:
    """Write the valid files that cases are altered from."""
    clips = synthesise(4)
    skeleton = next(iter(clips.values())).skeleton
    with write_motions(folder / "motions.parquet", skeleton) as writer:
        for name in sorted(clips):
            writer.add(name, clips[name].frames(0, 12))
    save("pacmo", train("pacmo", clips, n_epochs=1, width=4), folder / "pacmo.safetensors")
    save("gru", train("gru", clips, n_epochs=1, hidden=8), folder / "gru.safetensors")
    clip = next(iter(clips.values()))
    start = StartSettings(0.1, 0.2, 1.0, 100.0, 0.1, 1.0, 0.3, 0.3)
    limbs = find_limbs(skeleton, clip.person_a)
    config = PriorConfig(skeleton, limbs, "kinematic", 16, 2, 30, start)
    prior = build_skeleton_prior(config)
    facts = {"model": "kinematic", "config": model_config(prior)}
    write_weights(folder / "kinematic.safetensors", facts, model_state(prior))
    texts, numbers = ("clip",) * 7 + ("ntu25",), (30.0, 1.0)
    record = ClipRecord(*texts, *numbers, 31, 0, "file", "0" * 64, 0.1, 0.2, 0.3, 0, False)
    write_rows(folder / "clips.parquet", ClipRecord, [record] * 3)
    fault = QuarantineRecord("s", "f", "0", 1, "reason")
    write_rows(folder / "quarantine.parquet", QuarantineRecord, [fault] * 3)
    scores = [Score("row", 1, "metric", np.arange(4.0))] * 2
    write_scores(folder / "scores.parquet", scores, {"n": 3})
    scales = {"left_forearm": 1.0, "right_thigh": 1.2}
    row = VariationRecord("c~v", "c", "uniform", True, "", 0.5, {"error": 0.1}, scales, scales)
    write_variations(folder / "variations.parquet", [row] * 3, list(scales))


def _drop(g: Grammar, table: pa.Table) -> pa.Table:
    return table.drop_columns([table.column_names[g.integer(0, table.num_columns)]])


def _reorder(g: Grammar, table: pa.Table) -> pa.Table:
    return table.select(g.random.permutation(table.column_names).tolist())


def _rows(g: Grammar, table: pa.Table) -> pa.Table:
    return table.take(pa.array(g.random.integers(0, len(table), g.integer(0, 2 * len(table)))))


def _null(g: Grammar, table: pa.Table) -> pa.Table:
    index = g.integer(0, table.num_columns)
    values = table.column(index).to_pylist()
    values[g.integer(0, len(values))] = None
    field = table.schema.field(index).with_nullable(True)
    return table.set_column(index, field, pa.array(values, field.type))


def _retype(g: Grammar, table: pa.Table) -> pa.Table:
    """Write a column as another type: ragged lists, texts, numbers of another kind."""
    index = g.integer(0, table.num_columns)
    name, values = table.column_names[index], table.column(index).to_pylist()
    kind = g.integer(0, 4)
    if kind == 0:
        return table.set_column(index, name, pa.array([str(value) for value in values]))
    if kind == 1 and isinstance(values[0], list):
        # A null is of another alteration before this one.
        ragged = [value and value[: g.integer(0, len(value) + 1)] for value in values]
        return table.set_column(index, name, pa.array(ragged))
    if kind == 2:
        column = table.column(index)
        is_text = isinstance(values[0], str)
        return table.set_column(
            index, name, column.dictionary_encode() if is_text else pa.array(values)
        )
    return table.set_column(index, name, pa.array([1] * len(values), pa.int8()))


def _metadata(g: Grammar, table: pa.Table) -> pa.Table:
    facts = {
        key: value for key, value in table.schema.metadata.items() if not g.random.random() < 0.3
    }
    for key in facts:
        if key != b"pacmo" and g.random.random() < 0.7:
            facts[key] = json.dumps(_spoil_json(g, json.loads(facts[key]))).encode()
    return table.replace_schema_metadata(facts)


ALTERATIONS: tuple[Alteration, ...] = (_drop, _reorder, _rows, _null, _retype, _metadata)


def alter_parquet(g: Grammar, source: Path, target: Path) -> None:
    """Write a table as another program might: other row groups, statistics, columns, values."""
    table = pq.read_table(source)
    for _ in range(g.integer(0, 3)):
        table = ALTERATIONS[g.integer(0, len(ALTERATIONS))](g, table) if len(table) else table
    options: dict[str, Any] = {"row_group_size": g.integer(1, 40)}
    options |= {"write_statistics": bool(g.integer(0, 2)), "compression": g.pick(("zstd", "none"))}
    pq.write_table(table, target, **options)


def read_parquet(folder: Path) -> None:
    """Read the one file as what its name says."""
    (file,) = folder.iterdir()
    if file.stem == "motions":
        read_skeleton(file)
        names = [name for name, _ in stream_motions(file)]
        reader = MotionReader(file)
        for name in names[:2]:
            reader.read(name)
    elif file.stem == "clips":
        read_rows(file, ClipRecord)
    elif file.stem == "quarantine":
        read_rows(file, QuarantineRecord)
    elif file.stem == "scores":
        read_scores(file)
    else:
        read_variations(file)


def _spoil_json(g: Grammar, value: Any) -> Any:
    """Replace one value somewhere in a tree."""
    if g.random.random() < 0.15 or not isinstance(value, dict | list) or not value:
        return ODD_VALUES[g.integer(0, len(ODD_VALUES))]
    copy = value.copy()
    keys = list(copy) if isinstance(copy, dict) else range(len(copy))
    key = keys[g.integer(0, len(keys))]
    if isinstance(copy, dict) and g.random.random() < 0.1:
        del copy[key]
    else:
        copy[key] = _spoil_json(g, copy[key])
    return copy


def _spoil_tensor(g: Grammar, tensor: torch.Tensor) -> torch.Tensor:
    kinds = (torch.float64, torch.int32, torch.bool, torch.bfloat16)
    choices = (
        lambda: tensor.flatten()[:0],
        lambda: tensor.flatten(),
        lambda: tensor * float("nan"),
        lambda: tensor * 1e30,
        lambda: tensor * 0,
        lambda: tensor.to(kinds[g.integer(0, len(kinds))]),
    )
    spoilt: torch.Tensor = choices[g.integer(0, len(choices))]()
    return spoilt.contiguous()


def alter_weights(g: Grammar, source: Path, target: Path) -> None:
    """Write weights with another configuration, or other tensors."""
    config, state = read_weights(source)
    facts: Any = config
    names = sorted(state)
    for _ in range(g.integer(0, 3)):
        name, kind = names[g.integer(0, len(names))], g.integer(0, 4)
        if kind == 0:
            state.pop(name, None)
        elif kind == 1:
            state[f"{name}.more"] = torch.zeros(2)
        elif kind == 2 and name in state:
            state[name] = _spoil_tensor(g, state[name])
        else:
            facts = _spoil_json(g, facts)
    metadata = {"config": json.dumps(facts)} if not g.odd() else {"x": "y"}
    save_file(state, target, metadata=metadata)


def read_model(folder: Path) -> None:
    """Load the weights and let a model of reactions react to a walking line of joints."""
    (file,) = folder.iterdir()
    if file.stem == "kinematic":
        load_model(file, "skeleton_prior")
        return
    model = load_reaction_model(file)
    times = np.arange(20) / 30
    shape = (20, len(model.skeleton.joints), 3)
    motion = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    samples = 1 if is_deterministic(model) else 2
    random = torch.Generator().manual_seed(0)
    react(model, motion, times, out_times=times, n_samples=samples, random=random)


def write_archive(g: Grammar, target: Path) -> None:
    """Write an archive of takes, with odd names, methods, flags and sizes."""
    packed = io.BytesIO()
    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    with zipfile.ZipFile(packed, "w") as archive:
        for number in range(g.integer(1, 5)):
            name = f"s01s02/01/{number:03d}/skeleton_pos.txt"
            if g.odd():
                name = g.pick(
                    ("../x/01/001/skeleton_pos.txt", "/01/001/skeleton_pos.txt", "a" * 99)
                )
            method = methods[g.integer(0, 4)] if g.odd() else methods[g.integer(0, 2)]
            archive.writestr(name, b"1,2,3\n" * g.integer(0, 100), compress_type=method)
    data = bytearray(packed.getvalue())
    central = data.find(b"PK\x01\x02")
    if g.odd():
        data[central + 8] |= 1  # encrypted
    if g.odd():
        data[central + 24 : central + 28] = g.random.bytes(4)  # uncompressed size
    target.write_bytes(bytes(data))


def read_archive(folder: Path) -> None:
    """Extract every take of the one archive."""
    for _ in extract_skeletons(next(folder.iterdir())):
        pass


def write_mat(g: Grammar, folder: Path) -> None:
    """Write two dancers as MATLAB files, some variables of other shapes and types."""
    n_frames = g.integer(1, 9)
    for sex in ("male", "female"):
        (folder / sex).mkdir()
        shape = (n_frames, 15, 3) if not g.odd() else tuple(g.random.integers(0, 5, 3))
        values: dict[str, Any] = {f"v{i}_1": g.random.normal(size=shape) for i in range(2)}
        if g.odd():
            others = (np.array(["x"]), {"a": 1}, np.array([1j]), np.zeros((2, 2), "u1"), [[1], "b"])
            values["odd"] = others[g.integer(0, len(others))]
        savemat(folder / sex / "salsa.mat", values, do_compression=bool(g.integer(0, 2)))


def write_npy(g: Grammar, folder: Path) -> None:
    """Write two people as arrays, some of other shapes and types."""
    for person in ("person1", "person2"):
        (folder / person).mkdir()
        shape = (6, 70) if not g.odd() else tuple(g.random.integers(0, 80, g.integer(0, 4)))
        dtype = g.pick(("f4", "f8", "i4", "U3", "c8", "?", "f2", "O")) if g.odd() else "f4"
        array = g.random.normal(size=shape)
        values = array.astype(dtype) if dtype != "c8" else array + 1j
        np.save(folder / person / "7.npy", values, allow_pickle=True)
