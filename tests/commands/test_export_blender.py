"""Truth: Blender's own import of BVH and glTF, and the clip that was exported.

bpy, Blender as a Python module, wants a Python of its own: PACMO_BPY_PYTHON names the interpreter
of an environment that has it (docs/viewing.md).
"""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.data.interaction import Interaction, bone_lengths
from pacmo_core.data.skeleton import NTU25
from pacmo_core.store.motions import write_motions
from tests.formats.moving import moving

SCRIPT = Path(__file__).with_name("blender_positions.py")
# Made absolute here: the tests stand elsewhere. Not resolved: that would leave the environment.
GIVEN = os.environ.get("PACMO_BPY_PYTHON")
PYTHON = str(Path(GIVEN).absolute()) if GIVEN else sys.executable if find_spec("bpy") else ""
FPS = 30
MILLIMETRE = 1e-3
CLIP = Interaction(NTU25, np.arange(31) / FPS, moving(NTU25, 1, 31), moving(NTU25, 2, 31))


def blender(*files: Path) -> tuple[dict, str]:
    """Load files; return what the scene holds, and what Blender says."""
    if not PYTHON:
        pytest.skip("no bpy here, and PACMO_BPY_PYTHON names no Python that has it")
    command = [PYTHON, str(SCRIPT), str(FPS), *map(str, files)]
    # Blender's modules bring their own libraries: nothing of this environment may be in front.
    environment = {name: text for name, text in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stdout + done.stderr


def in_y_up(found: dict[str, list], prefix: str) -> np.ndarray:
    """Return (T, J, 3), the joints in the order of the skeleton."""
    x, y, z = np.moveaxis([found[prefix + joint] for joint in NTU25.joints], -1, 0)
    return np.stack([x, z, -y], axis=-1).swapaxes(0, 1)


@pytest.fixture
def exported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Path]]:
    monkeypatch.chdir(tmp_path)
    with write_motions(tmp_path / "data/clips/motions.parquet", NTU25) as writer:
        writer.add("one", CLIP)
    for suffix in ("bvh", "glb"):
        words = ["export", "one", "--out", f"x.{suffix}", "--ground", "--centre"]
        assert CliRunner().invoke(app, words).exit_code == 0
    return {"bvh": [tmp_path / "x_A.bvh", tmp_path / "x_B.bvh"], "glb": [tmp_path / "x.glb"]}


@pytest.mark.scheduled
@pytest.mark.parametrize(
    ("form", "armatures"),
    [("bvh", {"x_A": "", "x_B": ""}), ("glb", {"person_a": "a_", "person_b": "b_"})],
)
def test_blender_has_two_armatures_on_the_floor_with_every_joint_where_it_was(
    exported: dict[str, list[Path]], form: str, armatures: dict[str, str]
) -> None:
    scene, said = blender(*exported[form])
    assert "zero length" not in said
    assert scene["fps"] == FPS
    assert set(scene["armatures"]) == set(armatures)
    people = [in_y_up(scene["armatures"][name], prefix) for name, prefix in armatures.items()]
    roots = np.stack([person[:, NTU25.root] for person in people])
    assert min(person[..., 1].min() for person in people) == pytest.approx(0, abs=MILLIMETRE)
    np.testing.assert_allclose(roots.mean(axis=(0, 1))[[0, 2]], 0, atol=MILLIMETRE)
    source = [CLIP.person_a, CLIP.person_b]
    shift = (people[0] - source[0]).mean(axis=(0, 1))
    for person, motion in zip(people, source, strict=True):
        assert np.linalg.norm(person - motion - shift, axis=-1).max() <= MILLIMETRE
        lengths = bone_lengths(person, NTU25)
        assert np.ptp(lengths, axis=0).max() <= MILLIMETRE
