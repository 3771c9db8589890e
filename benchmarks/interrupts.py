"""Press Ctrl-C at random moments of a run; every process must end, and the next run must continue.

Usage: python -m benchmarks.interrupts [--moments N] [--experiment NAME] [--json] [STAGE ...]

A run is ``./run flow STAGE ...`` in a clone of the last commit, set up before, through a
pseudo-terminal. For each moment it starts with no output; after a random share of an undisturbed
run's time Ctrl-C is pressed, and a tenth of a second later again. ``ended``: after how many no
process of the run was left within 10 s; ``one_line``: how many said so in one line, without a
traceback; ``done_before``: how many runs had ended before; ``identical``: after how many the run
that followed left the undisturbed run's files under data, models and reports and its entries of
``dvc.lock``. ``slowest_s``: the longest time from Ctrl-C to the end of the last process.
"""

import os
import pty
import random
import select
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from ruamel.yaml import YAML

from benchmarks._figures import arguments, show
from benchmarks.faults import clear, hashes, start_run
from benchmarks.pipeline import call, clone
from pacmo_core.project.processes import marked_processes

CTRL_C = b"\x03"
VARIABLE = "PACMO_INTERRUPTED_RUN"
LIMIT_S = 10.0
RUN_LIMIT_S = 900.0


@dataclass(frozen=True)
class Interrupted:
    """How a run ended on Ctrl-C.

    Parameters
    ----------
    code : exit code; 0 if the run was done before
    text : what it wrote to the terminal
    remaining : numbers of its processes that were left after 10 s
    seconds : from Ctrl-C to the end of the last process
    """

    code: int
    text: str
    remaining: list[int]
    seconds: float

    @property
    def in_one_line(self) -> bool:
        """Whether it said once that it was interrupted, and nothing of a traceback."""
        lines = self.text.count("interrupted: ")
        return self.code == 0 or (self.code == 130 and lines == 1 and "Traceback" not in self.text)


def interrupt(command: list[str], folder: Path, delay_s: float) -> Interrupted:
    """Run a command on a pseudo-terminal and press Ctrl-C twice after a delay."""
    mark = {VARIABLE: uuid4().hex}
    environment = {k: v for k, v in os.environ.items() if k != "PREFECT_API_URL"}
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.execvpe(command[0], command, {**environment, "PYTHONPATH": str(folder), **mark})
    text = _read(terminal, time.monotonic() + delay_s)
    pressed = time.monotonic()
    for _ in range(2):
        with suppress(OSError):  # it has ended
            os.write(terminal, CTRL_C)
        text += _read(terminal, time.monotonic() + 0.1)
    text += _read(terminal, pressed + LIMIT_S)
    while (remaining := marked_processes(mark)) and time.monotonic() < pressed + LIMIT_S:
        time.sleep(0.05)
    seconds = time.monotonic() - pressed
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) if not remaining else -1
    os.close(terminal)
    return Interrupted(code, text.decode(errors="replace"), remaining, seconds)


def _read(terminal: int, deadline: float) -> bytes:
    """Read what is written to a terminal until a time, or until its last process closes it."""
    data = b""
    while (left := deadline - time.monotonic()) > 0:
        if select.select([terminal], [], [], left)[0]:
            try:
                part = os.read(terminal, 4096)
            except OSError:  # the end of a terminal on Linux
                break
            if not part:
                break
            data += part
    return data


def lock_entries(folder: Path) -> object:
    """Read ``dvc.lock``; the order of its entries is that in which stages ended."""
    return YAML(typ="safe").load(folder / "dvc.lock")


def measure(
    folder: Path, stages: list[str], n_moments: int, choice: random.Random
) -> dict[str, float]:
    """Interrupt runs and run again; return the figures."""
    clear(folder)
    start = time.monotonic()
    if start_run(folder, stages).wait(timeout=RUN_LIMIT_S):
        raise RuntimeError((folder / "flow.log").read_text()[-2000:])
    seconds = time.monotonic() - start
    expected = hashes(folder), lock_entries(folder)
    results = []
    for number in range(n_moments):
        clear(folder)
        moment = choice.uniform(0, seconds)
        result = interrupt([str(folder / "run"), "flow", *stages], folder, moment)
        succeeded = start_run(folder, stages).wait(timeout=RUN_LIMIT_S) == 0
        same = succeeded and (hashes(folder), lock_entries(folder)) == expected
        print(
            f"{number + 1}: Ctrl-C after {moment:.1f} s, ended after {result.seconds:.1f} s, "
            f"in one line {result.in_one_line}, identical {same}",
            file=sys.stderr,
        )
        results.append((result, same))
    return {
        "moments": n_moments,
        "ended": sum(not result.remaining for result, _ in results),
        "done_before": sum(result.code == 0 for result, _ in results),
        "one_line": sum(result.in_one_line for result, _ in results),
        "identical": sum(same for _, same in results),
        "slowest_s": max(result.seconds for result, _ in results),
        "undisturbed_s": seconds,
    }


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--moments", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--experiment", default="smallest")
    parser.add_argument("stages", nargs="*", metavar="STAGE")
    options = parser.parse_args()
    choice = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as place:
        folder = clone(Path(place) / "clone", options.experiment)
        call(folder, str(folder / "run"), "setup")
        figures = measure(folder, options.stages, options.moments, choice)
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
