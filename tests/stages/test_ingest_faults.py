"""What the stage ingest says of captures that it cannot use. Truth: bodies of known size."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.resample import from_y_up
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.store.motions import MotionReader
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, read_rows
from stages import cut
from stages.common.params import StageError
from stages.ingest import main
from tests.docs import ROOT
from tests.formats.rigged import mixamo, people


def prepare(folder: Path, monkeypatch: pytest.MonkeyPatch, settings: str) -> None:
    """Write ``params.yaml`` for pairs of BVH files, and stand in the folder."""
    default = (ROOT / "params.yaml").read_text()
    section = default[default.index("ingest:") : default.index("\ncut:")]
    lines = section.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("  settings:"))
    stop = next(i for i, line in enumerate(lines) if line.startswith("  include:"))
    lines[start:stop] = [f"  settings: {settings}"]
    text = "\n".join(lines).replace("format: ntu", "format: bvh")
    text = "\n".join(
        "  drop_joints: []" if line.startswith("  drop_joints") else line
        for line in text.splitlines()
    )
    (folder / "params.yaml").write_text(text + "\n")
    monkeypatch.chdir(folder)


def write_pair(raw: Path, name: str, unit: float, up: str) -> None:
    """Write a pair of walking people on Mixamo's joints."""
    skeleton, motions = mixamo(people())
    raw.mkdir(exist_ok=True)
    for person, motion in zip("AB", motions, strict=True):
        walk = 0.3 * np.sin(np.arange(len(motion)) / 20)[:, None, None] * np.array([0.0, 0.0, 1.0])
        in_units = (from_y_up((motion + walk).astype(np.float32), up) / unit).astype(np.float32)
        (raw / f"{name}_{person}.bvh").write_text(format_bvh(in_units, 30, skeleton))


SETTINGS = (
    "{preset: pair, unit: 0.01, up: y, fps: , end_sites: false, skip_frames: 0, "
    "max_root_distance: }"
)


def test_captures_that_a_wrong_unit_or_axis_makes_impossible_are_quarantined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(tmp_path, monkeypatch, SETTINGS)
    for name, unit, up in (("good", 0.01, "y"), ("inches", 0.0005, "y"), ("lying", 0.01, "z")):
        write_pair(tmp_path / "raw", name, unit, up)
    for person in "AB":
        text = (tmp_path / f"raw/good_{person}.bvh").read_text()
        (tmp_path / f"raw/one_sided_{person}.bvh").write_text(text.replace(":Left", ":West"))
    main(Path("raw"), Path("s"), Path("m.json"))
    (row,) = read_rows(Path("s/clips.parquet"), ClipRecord)
    assert (row.clip, row.synthetic) == ("good", False)
    reasons = {
        q.sequence: q.reason for q in read_rows(Path("s/quarantine.parquet"), QuarantineRecord)
    }
    assert "a person of 3" in reasons["inches"]
    assert reasons["one_sided"].startswith("no joints of a left and a right side, such as")
    assert "y was taken for up, but the trunk of a person is along z" in reasons["lying"]


def test_an_axis_that_most_captures_contradict_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(tmp_path, monkeypatch, SETTINGS)
    raw, sequences, metrics = Path("raw"), Path("sequences"), Path("metrics.json")
    for name, up in (("good", "y"), ("lying", "z")):
        write_pair(raw, name, 0.01, up)
    main(raw, sequences, metrics)
    write_pair(raw, "lying too", 0.01, "z")
    with pytest.raises(StageError) as caught:
        main(raw, sequences, metrics)
    said = "raw: 2 of 3 captures are on their sides: lying_A.bvh: y was taken for up, but"
    assert str(caught.value).startswith(said)


def test_captures_beside_the_scripts_of_the_default_are_synthetic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(tmp_path, monkeypatch, SETTINGS)
    write_pair(tmp_path / "raw", "made", 0.01, "y")
    (tmp_path / "raw" / "scripts.json").write_text("{}")
    main(Path("raw"), Path("s"), Path("m.json"))
    (row,) = read_rows(Path("s/clips.parquet"), ClipRecord)
    assert row.synthetic


def test_where_no_capture_is_usable_the_names_wanted_and_seen_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(tmp_path, monkeypatch, SETTINGS)
    write_pair(tmp_path / "raw", "x", 0.01, "y")
    for person in "AB":
        file = tmp_path / "raw" / f"x_{person}.bvh"
        file.rename(tmp_path / "raw" / f"hug_{person}1.bvh")
    with pytest.raises(StageError) as fault:
        main(Path("raw"), Path("s"), Path("m.json"))
    assert "no capture of 2 is usable" in str(fault.value)
    assert "wanted names such as NAME_A.bvh and NAME_B.bvh" in str(fault.value)
    assert "there are hug_A1.bvh, hug_B1.bvh" in str(fault.value)


def test_where_no_capture_is_usable_each_is_listed_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(tmp_path, monkeypatch, SETTINGS)
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "a_alone.bvh").write_text("HIERARCHY")
    for name, unit in (("x", 0.0005), ("y", 0.0004), ("z", 0.0003)):
        write_pair(tmp_path / "raw", name, unit, "y")
    with pytest.raises(StageError) as fault:
        main(Path("raw"), Path("s"), Path("m.json"))
    text = str(fault.value)
    assert "no capture of 4 is usable; 3: a person of " in text, "not the first: the most common"
    assert "x_A.bvh" in text
    assert text.endswith("pacmo quarantine s lists the reason of each")
    rows = read_rows(Path("s/quarantine.parquet"), QuarantineRecord)
    assert [row.sequence for row in rows] == ["a_alone.bvh", "x", "y", "z"]
    shown = CliRunner().invoke(app, ["quarantine", "s"])
    assert "4 of 4" in shown.output


@pytest.mark.parametrize(
    ("settings", "drop", "said"),
    [
        (SETTINGS.replace("0.01", "centimetres"), "[]", "ingest.settings: unit: "),
        (SETTINGS.replace("pair", "mixamo"), "[]", "ingest.settings: preset must be one of "),
        (SETTINGS.replace("0.01", ""), "[]", "preset pair states no unit: wanted it as a setting"),
        (SETTINGS, "[nose]", r"drop_joints: .*cannot remove \['nose'\]; its joints are "),
    ],
)
def test_a_wrong_setting_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: str, drop: str, said: str
) -> None:
    prepare(tmp_path, monkeypatch, settings)
    write_pair(tmp_path / "raw", "x", 0.01, "y")
    text = (tmp_path / "params.yaml").read_text().replace("drop_joints: []", f"drop_joints: {drop}")
    (tmp_path / "params.yaml").write_text(text)
    with pytest.raises(StageError, match=said) as fault:
        main(Path("raw"), Path("s"), Path("m.json"))
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        ("skeleton: ntu26", "skeleton: wanted one of ntu25, sbu15, duet15, .*; got 'ntu26'"),
        (
            "joint_names: [mixamo]",
            "joint_names: wanted a skeleton, whose joints they are; got none",
        ),
        (
            "skeleton: ntu25, joint_names: [mixamo.json]",
            "joint_names: wanted .*mixamo, .*; got 'mixamo.json'",
        ),
        # Its hand tips are no joints of Mixamo's, and nothing says where they are.
        (
            "skeleton: ntu25",
            r"skeleton: .* names no joint for .*joint_names, as in joint_names: \[left_hand_tip=",
        ),
    ],
)
def test_joints_that_cannot_be_found_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, joints: str, said: str
) -> None:
    prepare(tmp_path, monkeypatch, SETTINGS)
    write_pair(tmp_path / "raw", "x", 0.01, "y")
    state_joints(tmp_path, *joints.split(", "))
    with pytest.raises(StageError, match=said) as fault:
        main(Path("raw"), Path("s"), Path("m.json"))
    assert "\n" not in str(fault.value)


def test_captures_are_stored_in_the_joints_of_another_skeleton(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(tmp_path, monkeypatch, SETTINGS)
    write_pair(tmp_path / "raw", "x", 0.01, "y")
    state_joints(tmp_path, "skeleton: sbu15", "joint_names: [mixamo, 'torso=mixamorig:Spine1']")
    main(Path("raw"), Path("s"), Path("m.json"))
    stored = MotionReader(Path("s/motions.parquet")).read("x")
    assert stored.skeleton == SBU15
    state_joints(tmp_path, 'skeleton: ""', "joint_names: []")
    main(Path("raw"), Path("own"), Path("m.json"))
    whole = MotionReader(Path("own/motions.parquet")).read("x")
    for joint, name in (("left_foot", "LeftFoot"), ("torso", "Spine1"), ("head", "Head")):
        np.testing.assert_allclose(
            stored.person_b[:, SBU15.joints.index(joint)],
            whole.person_b[:, whole.skeleton.joints.index(f"mixamorig:{name}")],
            atol=1e-6,
        )


def state_joints(folder: Path, *lines: str) -> None:
    """Replace settings of the section ``ingest``."""
    text = (folder / "params.yaml").read_text()
    for line in lines:
        text = re.sub(rf"(?m)^  {line.split(':')[0]}: .*$", f"  {line}", text)
    (folder / "params.yaml").write_text(text)


@pytest.mark.parametrize("seconds", ["0", "-1", ".nan"])
def test_clips_of_no_length_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seconds: str
) -> None:
    (tmp_path / "params.yaml").write_text(f"cut: {{clip_seconds: {seconds}}}\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StageError, match="clip_seconds must be > 0; got "):
        cut.main(Path("s"), Path("c"))
