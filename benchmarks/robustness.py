"""Read thousands of random and crafted files: a reader gives a reading, or one line of reason.

Usage: python -m benchmarks.robustness [--json] [--cases N] [--seed S] [--only READER]

Cases are drawn anew for each seed from the formats' grammars, not by byte flips alone; the readers
are those of raw captures, Parquet, weights, archives and the inbox, and the server of a study. Each
runs in a worker process, under an alarm, and its memory is the growth of the process's peak.
``crashed``: exceptions other than the documented errors, errors of several lines, processes that
died, and what the checks of inbox and study find. ``hung``: over 10 s of the processor, or 60 s of
the clock. ``over_memory``: over 1 GB.
 ``wrongly_accepted``: files of a table of crafted ones that must be refused and were not.
``accepted`` is the share of random cases that were read. Faults are printed on stderr with the
reader and the seed that draw them again.
"""

import multiprocessing
import resource
import shutil
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

import torch

from benchmarks._crafted import crafted_cases
from benchmarks._figures import arguments, show
from benchmarks._fuzz_binary import make_templates
from benchmarks._fuzz_cases import check_message, run_case, targets
from benchmarks._fuzz_study import serving_study

LIMIT_S = 10  # of the processor; the clock of a busy machine would call slow cases hung
WAIT_S = 60  # of the clock, for a case that waits
MAX_GROWTH_KB = 1_000_000
ADDRESS_SPACE = 8 << 30  # what a worker may ask for: the machine survives a reader that does not
FAULTS = ("crashed", "hung", "over_memory", "wrongly_accepted")


class HungError(BaseException):
    """The alarm: no handler of ``Exception`` may catch it."""


@dataclass(frozen=True)
class Job:
    """What a worker runs.

    Parameters
    ----------
    templates : folder of the valid files
    names : the readers, or the crafted cases
    seed : of the random cases; None for the crafted ones
    """

    templates: Path
    names: tuple[str, ...]
    seed: int | None

    def label(self, number: int) -> str:
        """Describe a case so that it can be drawn again."""
        name = self.names[number % len(self.names)]
        return name if self.seed is None else f"{name}, seed {self.seed}, case {number}"

    def run(self, number: int, folder: Path) -> str:
        """Run one case; return its outcome."""
        name = self.names[number % len(self.names)]
        if self.seed is not None:
            target = targets(self.templates)[name]
            return "accepted" if run_case(target, (self.seed, number), folder) else "refused"
        case = crafted_cases()[name]
        try:
            case.run(folder, self.templates)
        except case.documented as error:
            check_message(error)
            return "refused"
        return "wrongly_accepted"


def work(job: Job, start: int, stop: int, out: Connection) -> None:
    """Run cases in a process of its own; send (number, outcome, detail) after each."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    for over_time in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(over_time, _alarm)
    at_start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # a fork has its parent's pages
    for number in range(start, stop):
        outcome, detail = _outcome(job, number)
        growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - at_start
        if growth > MAX_GROWTH_KB and outcome != "hung":
            outcome, detail = "over_memory", f"{growth / 1e6:.2f} GB; {detail}"
        out.send((number, outcome, detail))
        if outcome in ("over_memory", "hung"):
            return  # the peak never falls: the next case needs a new process


def _alarm(_number: int, _frame: object) -> None:
    raise HungError


def _outcome(job: Job, number: int) -> tuple[str, str]:
    folder = Path(tempfile.mkdtemp())
    try:
        signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
        signal.setitimer(signal.ITIMER_REAL, WAIT_S)
        return job.run(number, folder), ""
    except HungError:
        return "hung", traceback.format_exc(limit=-2)
    except MemoryError as error:
        return "over_memory", repr(error)
    except Exception:  # noqa: BLE001  # what else a reader raises is what is counted
        return "crashed", traceback.format_exc(limit=-3)
    finally:
        for timer in (signal.ITIMER_PROF, signal.ITIMER_REAL):
            signal.setitimer(timer, 0)
        shutil.rmtree(folder, ignore_errors=True)


@dataclass
class Tally:
    """Outcomes so far, and the first faults in words."""

    outcomes: Counter[str] = field(default_factory=Counter)

    def add(self, label: str, outcome: str, detail: str) -> None:
        """Count one case; print a fault."""
        self.outcomes[outcome] += 1
        if outcome in FAULTS:
            print(f"{outcome}: {label}\n{detail}", file=sys.stderr, flush=True)


def supervise(job: Job, n_cases: int, tally: Tally) -> None:
    """Run all cases of a job, in a new process after each that hung, died or grew."""
    context = multiprocessing.get_context("fork")
    done = 0
    while done < n_cases:
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=work, args=(job, done, n_cases, sender))
        process.start()
        sender.close()
        done = _receive(job, receiver, (done, n_cases), tally)
        if process.is_alive():
            process.kill()
        process.join()


def _receive(job: Job, receiver: Connection, cases: tuple[int, int], tally: Tally) -> int:
    """Take results until the process ends; return the number of the next case."""
    done, stop = cases
    while done < stop:
        try:
            if not receiver.poll(3 * WAIT_S):
                tally.add(job.label(done), "hung", "without leaving compiled code")
                return done + 1
            result: tuple[int, str, str] = receiver.recv()
            number, outcome, detail = result
        except EOFError:
            tally.add(job.label(done), "crashed", "the process died")
            return done + 1
        tally.add(job.label(number), outcome, detail)
        done = number + 1
        if outcome in ("over_memory", "hung"):
            return done
    return done


def main() -> None:
    """Run the crafted and the random cases, and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="readers whose names contain this")
    options = parser.parse_args()
    # A fork of a process with threads of OpenMP waits for them for ever.
    torch.set_num_threads(1)
    tally = Tally()
    with tempfile.TemporaryDirectory() as place, serving_study(Path(place)):
        templates = Path(place)
        make_templates(templates)
        chosen: Callable[[str], bool] = lambda name: options.only in name  # noqa: E731
        crafted = tuple(filter(chosen, crafted_cases()))
        supervise(Job(templates, crafted, None), len(crafted), tally)
        names = tuple(filter(chosen, targets(templates)))
        supervise(Job(templates, names, options.seed), options.cases if names else 0, tally)
    figures: dict[str, float] = {"cases": tally.outcomes.total(), "crafted": len(crafted)}
    figures |= {name: tally.outcomes[name] for name in FAULTS}
    figures["accepted"] = tally.outcomes["accepted"] / max(options.cases, 1)
    show(figures, as_json=options.json)
    sys.exit(any(tally.outcomes[name] for name in FAULTS))


if __name__ == "__main__":
    main()
