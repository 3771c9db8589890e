"""What is trusted: the pins in pyproject.toml, and a stand-in for holosoma-retargeting."""

import os
import shlex
import sys
import tomllib
from pathlib import Path

import pytest

from benchmarks import _holosoma
from benchmarks._holosoma import PYTHON_VARIABLE, VERSION, frames_per_second, holosoma_figures

ROOT = Path(__file__).parents[1]
MEASUREMENT = '{"version": "%s", "frames": 196, "process_seconds": 28.0}'
STAND_IN = {
    "holosoma_retargeting/__init__.py": "",
    "holosoma_retargeting/demo_data/OMOMO_new/sub3_largebox_003.pt": "",
    "holosoma_retargeting/examples/__init__.py": "",
    "holosoma_retargeting/examples/robot_retarget.py": """
import operator, os, pathlib, sys, time

RetargetingConfig = "the class of its configuration"
while time.process_time() < 0.2:
    pass


class InteractionMeshRetargeter:
    def retarget_motion(self, motion):
        while time.process_time() < self.end:
            pass
        print("Saving results", file=sys.stdout)
        return motion, [], [], []


def main(words):
    assert not hasattr(operator, "BATCH"), "the standard library's operator"
    assert os.environ["OMP_NUM_THREADS"] == os.environ["RAYON_NUM_THREADS"] == "1"
    options = dict(zip(words[::2], words[1::2], strict=True))
    assert pathlib.Path(options["--data_path"], options["--task-name"] + ".pt").exists()
    assert not any(pathlib.Path(options["--save_dir"]).iterdir())
    retargeter = InteractionMeshRetargeter()
    retargeter.end = time.process_time() + 0.02
    retargeter.retarget_motion([None] * 10)
""",
    "tyro.py": "def cli(kind, args):\n    return args\n",
}


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make an environment whose holosoma-retargeting only passes time."""
    metadata = f"Metadata-Version: 2.1\nName: holosoma-retargeting\nVersion: {VERSION}\n"
    files = STAND_IN | {f"holosoma_retargeting-{VERSION}.dist-info/METADATA": metadata}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    python = tmp_path / "python"
    words = ["env", f"PYTHONPATH={tmp_path}", sys.executable, "-P"]  # -I would ignore PYTHONPATH
    python.write_text(f'#!/bin/sh\n[ "$1" = -I ] && exec {shlex.join(words)} "$2"\n')
    python.chmod(0o755)
    monkeypatch.setenv(PYTHON_VARIABLE, str(python))
    return tmp_path


def test_without_an_environment_one_line_says_how_to_install_and_no_figure_is_given(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv(PYTHON_VARIABLE, raising=False)
    assert holosoma_figures() == {}
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1
    assert f"{PYTHON_VARIABLE}=" in printed.err and "--group holosoma" in printed.err


def test_the_dependency_group_pins_the_version_that_is_measured_and_our_torch() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    group = settings["dependency-groups"]["holosoma"]
    assert f"{_holosoma.PACKAGE}=={VERSION}" in group
    assert set(settings["project"]["dependencies"]) & set(
        group
    )  # torch, of which ranges bring CUDA
    assert set(settings["project"]["optional-dependencies"]["peers"]) >= set(group[2:])


def test_the_measurement_is_the_last_line_of_what_it_prints() -> None:
    output = f"Loading robot model\n\nSaving results\n{MEASUREMENT % VERSION}\n"
    assert frames_per_second(output) == 7


@pytest.mark.parametrize(
    ("last", "message"),
    [
        ("", "wanted frames and process_seconds, got 'no output'"),
        ("Saving results", "wanted frames and process_seconds, got 'Saving results'"),
        ('{"version": "0.1.0", "frames": 196}', "wanted frames and process_seconds, got '{"),
        ("196", "wanted frames and process_seconds, got '196'"),
        ((MEASUREMENT % VERSION).replace("28.0", "0"), "wanted frames and process_seconds, got"),
        (MEASUREMENT % "0.2.0", f"wanted holosoma-retargeting {VERSION}, got 0.2.0"),
    ],
)
def test_other_output_is_refused(last: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        frames_per_second(f"Loading robot model\n{last}\n" if last else last)


def test_the_package_runs_in_its_environment_and_its_retargeting_alone_is_timed(
    environment: Path,
) -> None:
    before = sorted(environment.rglob("*.npz")), Path.cwd(), dict(os.environ)
    figures = holosoma_figures()
    assert (sorted(environment.rglob("*.npz")), Path.cwd(), dict(os.environ)) == before
    # Ten frames in 0.02 s, as two clocks have it, after imports of 0.2 s: with these 45 a second.
    assert list(figures) == ["holosoma_frames_per_s"]
    assert 46 < figures["holosoma_frames_per_s"] < 510


def test_an_environment_without_the_package_is_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(PYTHON_VARIABLE, sys.executable)
    with pytest.raises(SystemExit) as refused:
        holosoma_figures()
    message = str(refused.value)
    assert message.startswith(f"{PYTHON_VARIABLE}={sys.executable}: ") and "\n" not in message
    assert f"wanted an environment with holosoma-retargeting {VERSION}, got one without" in message


def test_an_interpreter_that_is_not_there_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PYTHON_VARIABLE, str(tmp_path / "missing"))
    with pytest.raises(SystemExit, match="missing: .*No such file"):
        holosoma_figures()


def test_a_failure_within_the_package_is_reported_by_its_last_line(environment: Path) -> None:
    script = environment / "holosoma_retargeting/examples/robot_retarget.py"
    script.write_text("raise RuntimeError('CVXPY solve failed: infeasible')\n")
    with pytest.raises(SystemExit, match="code 1: RuntimeError: CVXPY solve failed: infeasible$"):
        holosoma_figures()
