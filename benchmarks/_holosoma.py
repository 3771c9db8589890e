"""The published per-frame retargeter: holosoma-retargeting, which implements OmniRetarget.

It retargets one person to a robot (Unitree G1) by an interaction mesh with the ground, frame by
frame. Its dependencies conflict with ours (an older NumPy), so it runs in an environment of its
own, by this file as a script, on the data that it ships: the command ``robot_only`` of its README
without the viewer, all settings its own. The time is that of its ``retarget_motion``, without
imports, reading and loading the robot.
"""

import importlib
import importlib.metadata
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

PACKAGE, MODULE, VERSION = "holosoma-retargeting", "holosoma_retargeting", "0.1.0"
PYTHON_VARIABLE = "PACMO_HOLOSOMA_PYTHON"
# Rayon's as well: Clarabel is written in Rust.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"), "1"
)
DEMO = (
    "--data_path", "demo_data/OMOMO_new", "--task-type", "robot_only",
    "--task-name", "sub3_largebox_003", "--data_format", "smplh",
)  # fmt: skip
NOT_INSTALLED = (
    f"{PACKAGE} {VERSION} is not measured: python3 -m venv --without-pip DIR; ./run pip --python "
    f"DIR/bin/python install --group holosoma; export {PYTHON_VARIABLE}=DIR/bin/python"
)


def holosoma_figures() -> dict[str, float]:
    """Return ``holosoma_frames_per_s``, frames per process second; nothing if not installed.

    Raises
    ------
    SystemExit
        If the environment that ``PACMO_HOLOSOMA_PYTHON`` names cannot run the package or has
        another version of it, in one line.
    """
    python = os.environ.get(PYTHON_VARIABLE)
    if not python:
        print(NOT_INSTALLED, file=sys.stderr)
        return {}
    print(f"{PACKAGE} {VERSION} retargets its own motion (a minute)", flush=True)
    try:
        return {"holosoma_frames_per_s": frames_per_second(_run(python))}
    except (OSError, ValueError) as error:
        raise SystemExit(f"{PYTHON_VARIABLE}={python}: {error}") from None


def frames_per_second(output: str) -> float:
    """Return frames per process second from the output of this file as a script.

    Raises
    ------
    ValueError
        If its last line is not the measurement, or that of another version of the package.
    """
    last = (output.strip().splitlines() or ["no output"])[-1]
    try:
        measured = json.loads(last)
        version, rate = measured["version"], measured["frames"] / measured["process_seconds"]
    except (ValueError, KeyError, TypeError, ZeroDivisionError):
        raise ValueError(f"wanted frames and process_seconds, got {last!r}") from None
    if version != VERSION:
        raise ValueError(f"wanted {PACKAGE} {VERSION}, got {version}")
    return float(rate)


def _run(python: str) -> str:
    # -I: of another environment than ours, and without this folder, whose operator.py would
    # replace the standard library's.
    done = subprocess.run(
        [python, "-I", __file__],
        env=os.environ | ONE_THREAD,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise ValueError(f"{PACKAGE} ended with code {done.returncode}: {last}")
    return done.stdout


def retarget_demo() -> dict[str, object]:
    """Retarget its own motion, in its environment; return version, frames and process seconds."""
    spec = importlib.util.find_spec(MODULE)
    if spec is None or spec.origin is None:
        raise SystemExit(f"wanted an environment with {PACKAGE} {VERSION}, got one without")
    os.chdir(Path(spec.origin).parent)  # its robots and motions are paths relative to it
    example = importlib.import_module(f"{MODULE}.examples.robot_retarget")
    measured: dict[str, object] = {"version": importlib.metadata.version(PACKAGE)}
    retargeter = example.InteractionMeshRetargeter
    retargeter.retarget_motion = _timed(retargeter.retarget_motion, measured)
    with tempfile.TemporaryDirectory() as folder:
        words = [*DEMO, "--save_dir", folder]
        example.main(importlib.import_module("tyro").cli(example.RetargetingConfig, args=words))
    return measured


def _timed(method: Callable[..., Any], measured: dict[str, object]) -> Callable[..., Any]:
    def timed(*arguments: Any, **options: Any) -> Any:
        start = time.process_time()
        result = method(*arguments, **options)
        measured["process_seconds"] = time.process_time() - start
        measured["frames"] = len(result[0])
        return result

    return timed


if __name__ == "__main__":
    print(json.dumps(retarget_demo()))
