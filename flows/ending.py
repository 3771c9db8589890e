"""How a flow that was started by hand ends: in one line, and by an exit code that means something.

0 done, or nothing to do; 1 failed; 2 wrong usage; 3 the gate held the model back; 4 another run
holds the lock.
"""

import sys
from collections.abc import Callable

from prefect.settings import PREFECT_API_URL

from pacmo_core.project.lock import BusyError
from pacmo_core.project.records import EXIT_CODES, FAILED, read_runs
from pacmo_core.project.workspace import EXIT_BUSY, RUNS, CommandError


def by_hand_or_flow(as_flow: Callable[[], object], by_hand: Callable[[], object]) -> int:
    """Run the flow on the server that the settings name, or the plain function without one.

    Returns
    -------
    the exit code
    """
    code = ending(as_flow if PREFECT_API_URL.value() else by_hand)
    return code or EXIT_CODES[read_runs(RUNS)[-1].outcome]


def ending(do: Callable[[], object]) -> int:
    """Do it, tell in one line what went wrong, and give the exit code."""
    try:
        do()
    except BusyError as busy:
        return _say(busy, EXIT_BUSY)
    except (CommandError, OSError) as fault:
        return _say(fault, EXIT_CODES[FAILED])
    return 0


def _say(fault: Exception, code: int) -> int:
    sys.stderr.write(f"pacmo: {' '.join(str(fault).split())}\n")
    return code
