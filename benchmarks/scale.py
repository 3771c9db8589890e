"""Cost of each stage at three sizes, extrapolated by a line to a million clips.

Usage: python -m benchmarks.scale [--sizes 50 100 200] [--clips 1000000] [--json]

The stages' own commands, on synthetic captures of the NTU format
(``augment``: one variation a clip; ``train_pacmo``: one epoch of the default's network, the others
as ``smallest`` has them). For each stage: processor ``ms`` a clip, processor ``hours`` and
``gb`` of its outputs for all clips, and ``bend``: the cost of a clip between the two larger sizes
relative to the slope; far above 1 the extrapolation is not valid.
``dvc``: one ``dvc status``, which looks at every raw file.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

from benchmarks._figures import arguments, show
from benchmarks.incremental import set_captures
from benchmarks.pipeline import call, clone, plain_commands, processor_seconds
from pacmo_core.project.experiments import default_params

STAGES = ("ingest", "cut", "split", "augment", "train_pacmo", "react", "evaluate_pacmo")
NEEDED = ("train_autoencoder", "train_matcher", "react_oracle")
OUTPUTS = {
    "ingest": "data/sequences",
    "cut": "data/clips",
    "split": "data/splits",
    "augment": "data/variations",
    "react": "data/reactions/1/pacmo",
    "evaluate_pacmo": "data/scores",
}
HOUR, GB = 3600.0, 1e9


def measure(folder: Path, n_clips: int) -> dict[str, tuple[float, float]]:
    """Run the stages with N captures; return processor seconds and bytes of each."""
    set_captures(folder, n_clips)
    _set_network(folder)
    status = (sys.executable, "-m", "dvc", "status", "--json")
    before = processor_seconds()
    call(folder, *status)
    figures = {"dvc": (processor_seconds() - before, 0.0)}
    for command in plain_commands(folder):
        name = _name(command)
        if not _is_wanted(name, command):
            continue
        before = processor_seconds()
        call(folder, "sh", "-c", command)
        if name in STAGES:
            figures[name] = (
                processor_seconds() - before,
                float(_size(folder / OUTPUTS.get(name, "none"))),
            )
    return figures


def line(sizes: list[int], values: list[float]) -> tuple[float, float]:
    """Fit a line; return its slope, and the last slope relative to it."""
    slope = float(np.polyfit(sizes, values, 1)[0])
    last = (values[-1] - values[-2]) / (sizes[-1] - sizes[-2])
    return slope, last / slope if slope > 0 else 0.0


def _name(command: str) -> str:
    """Return the stage of a command, ``train_MODEL`` for a training."""
    _, _, module, *rest = command.split()
    name = module.removeprefix("stages.")
    if name != "train":
        return name
    (model,) = (word.removeprefix("--model=") for word in rest if word.startswith("--model="))
    return f"train_{model}"


def _is_wanted(name: str, command: str) -> bool:
    if name == "react":
        return "pacmo/1" in command
    return name in (*STAGES, *NEEDED)


def _set_network(folder: Path) -> None:
    """Set the default's network of PaCMO, for one epoch."""
    path, yaml = folder / "params.yaml", YAML()
    params = yaml.load(path)
    network = YAML(typ="safe").load(default_params())["train_pacmo"]
    short = {"n_epochs": 1, "warmup_epochs": 0, "validate_from": 0, "validate_every": 1}
    params["train_pacmo"] = {**network, **short}
    yaml.dump(params, path)


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def main() -> None:
    """Measure, extrapolate and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--sizes", type=int, nargs=3, default=[50, 100, 200])
    parser.add_argument("--clips", type=int, default=1_000_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        runs = []
        for size in options.sizes:
            folder = clone(Path(place) / "clone", "smallest")
            runs.append(measure(folder, size))
            shutil.rmtree(folder)
            print(f"{size} clips: {runs[-1]}", file=sys.stderr, flush=True)
    figures: dict[str, float] = {}
    for name in runs[0]:
        slope, bend = line(options.sizes, [run[name][0] for run in runs])
        per_clip, _ = line(options.sizes, [run[name][1] for run in runs])
        figures |= {
            f"{name}_ms": 1e3 * slope,
            f"{name}_bend": bend,
            f"{name}_hours": slope * options.clips / HOUR,
            f"{name}_gb": per_clip * options.clips / GB,
        }
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
