"""Truth: docs/augment.md itself: its commands and its Python run as they stand there."""

import re
import shlex
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.data.interaction import Motion
from pacmo_core.data.segments import segments
from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.store.motions import stream_motions, write_motions
from pacmo_core.store.tables import VariationRecord, write_variations
from tests.commands.test_augment import CLIP, PARAMS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "augment.md").read_text(encoding="utf-8")
COMMANDS = [
    line.partition("  #")[0]
    for line in (PAGE + (ROOT / "README.md").read_text(encoding="utf-8")).splitlines()
    if line.startswith("./run pacmo augment ")
]
# Options of the commands that state the unit and the upward axis of the files.
CENTIMETRES, PRESET = "--from-unit cm", "--preset duo_mocap"


def bvh(motion: Motion, command: str) -> str:
    """Write a person's file as a command takes it to be."""
    if PRESET in command:
        motion = np.stack([motion[..., 0], -motion[..., 2], motion[..., 1]], axis=-1)
    return format_bvh(motion * np.float32(100 if CENTIMETRES in command else 1), 15, SBU15)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Change to a folder with parameters, clips and variations, as ``./run`` does."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text(PARAMS.read_text())
    with write_motions(tmp_path / "data/clips/motions.parquet", SBU15) as writer:
        writer.add("NAME", CLIP)
    names = [segment.name for segment in segments(SBU15)]
    body = dict.fromkeys(names, 1.0)
    longer = body | {"left_forearm": 1.2}
    rows = [
        VariationRecord("c~1", "c", "single", True, "", 0.5, {}, body, longer),
        VariationRecord("c~2", "c", "single", False, "seam", 2.0, {}, body, longer),
        VariationRecord("c~3", "c", "single", True, "", 0.5, {}, body, body),
    ]
    write_variations(tmp_path / "data/variations/default/variations.parquet", rows, names)
    return tmp_path


def test_there_are_commands_to_try():
    assert len(COMMANDS) >= 3
    assert any(CENTIMETRES in line for line in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_page_writes_both_people_in_the_format_of_the_input(command, project):
    for person, motion in (("A", CLIP.person_a), ("B", CLIP.person_b)):
        (project / f"DUO_{person}.bvh").write_text(bvh(motion, command))
    _, _, *words = shlex.split(command)
    said = CliRunner().invoke(app, words)
    assert said.exit_code == 0, said.output
    out = Path(words[words.index("--out") + 1])
    if out.suffix == ".parquet":
        assert [name for name, _ in stream_motions(out)] == ["NAME~b-tall_adult"]
        assert out.with_suffix(".html").exists()
    else:
        names = sorted(path.name for path in out.iterdir())
        assert names == ["DUO_A.bvh", "DUO_A.html", "DUO_B.bvh"]
        for path in out.glob("*.bvh"):
            before = (project / path.name).read_text()
            assert re.findall(r"JOINT (\w+)", path.read_text()) == re.findall(
                r"JOINT (\w+)", before
            )


def test_the_python_of_the_page_selects_accepted_variations_with_longer_forearms(project):
    (program,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    *before, last = program.replace("\n)\n", "\n)").split("\nfacts.")
    names = {}
    exec(f"{before[0]}\nresult = facts.{last}", names)  # the page's own code
    assert names["result"]["variation"].to_list() == ["c~1"]
    assert isinstance(names["result"], pl.DataFrame)
