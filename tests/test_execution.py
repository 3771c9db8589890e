"""Truth: the same done one after the other; processes that are killed, at the worst moment too."""

import inspect
import os
import signal
import time
from itertools import islice

import psutil
import pytest

from pacmo_core.execution import ProcessExecutor

pytestmark = pytest.mark.slow
ITEMS = range(30)


def squared(number: int) -> int:
    time.sleep(0.02 * (number % 3))
    return number**2


def refuse(number: int) -> int:
    raise ValueError(f"not {number}")


def killed(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def killed_in_the_middle_of_its_answer(_: int) -> None:
    caller = inspect.currentframe().f_back  # type: ignore[union-attr]  # CPython has frames
    os.write(caller.f_locals["pipe"].fileno(), b"\0\0\1\0 and no more")
    killed(0)


def children() -> list[psutil.Process]:
    return [
        child for child in psutil.Process().children() if "spawn_main" in " ".join(child.cmdline())
    ]


def test_all_is_done_in_order_or_as_it_comes() -> None:
    with ProcessExecutor(2) as processes:
        assert list(processes.map_ordered(squared, ITEMS)) == [n**2 for n in ITEMS]
        assert sorted(processes.map_unordered(squared, ITEMS)) == [n**2 for n in ITEMS]
        assert list(processes.map_ordered(squared, [])) == []
        assert len(children()) == 2
    assert children() == []


def test_what_is_raised_there_is_raised_here_and_says_where() -> None:
    with ProcessExecutor(2) as processes:
        with pytest.raises(ValueError, match="not 3") as raised:
            list(processes.map_ordered(refuse, [3]))
        assert "in refuse" in raised.value.__notes__[0]
        assert list(processes.map_unordered(squared, [4])) == [16]


@pytest.mark.parametrize("how", [killed, killed_in_the_middle_of_its_answer])
def test_a_process_that_is_killed_is_told_of_and_not_waited_for(how) -> None:
    with pytest.raises(ChildProcessError, match="exit code -9"), ProcessExecutor(2) as processes:
        list(processes.map_unordered(how, ITEMS))
    assert children() == []


def test_who_takes_no_more_leaves_nothing_running() -> None:
    with ProcessExecutor(2) as processes:
        assert list(islice(processes.map_ordered(squared, ITEMS), 2)) == [0, 1]
    assert children() == []
