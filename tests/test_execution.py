"""What is trusted: results computed one after the other; processes that the test kills.

The Dask cluster is a real one, of two workers on this machine.
"""

import inspect
import os
import signal
import subprocess
import sys
import time
from functools import partial
from itertools import islice
from pathlib import Path

import psutil
import pytest

from pacmo_core.execution import ProcessExecutor, open_executor
from pacmo_core.ingestion import read_on_worker
from stages.augment import arguments
from stages.augment import main as augment
from stages.common.files import SCHEDULER
from stages.ingest import main as ingest
from tests.augmentation.sources import source
from tests.stages.augmenting import COMMAND, lay_out, result
from tests.test_ingestion import PARAMS, bodies, write

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
def test_a_killed_process_is_an_error_and_not_waited_for(how) -> None:
    with pytest.raises(ChildProcessError, match="exit code -9"), ProcessExecutor(2) as processes:
        list(processes.map_unordered(how, ITEMS))
    assert children() == []


def test_who_takes_no_more_leaves_nothing_running() -> None:
    with ProcessExecutor(2) as processes:
        assert list(islice(processes.map_ordered(squared, ITEMS), 2)) == [0, 1]
    assert children() == []


PARENT = """
import sys, time
from pathlib import Path
from pacmo_core.execution import ProcessExecutor
from tests.test_execution import wait_for_ever
if __name__ == "__main__":
    with ProcessExecutor(2) as processes:
        list(processes.map_ordered(wait_for_ever, [Path(sys.argv[1])] * 2))
"""


def wait_for_ever(folder: Path) -> None:
    (folder / f"{os.getpid()}").touch()
    time.sleep(3600)


def test_workers_end_when_their_parent_is_killed(tmp_path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    (tmp_path / "workers").mkdir()
    parent = subprocess.Popen(
        [sys.executable, tmp_path / "parent.py", tmp_path / "workers"],
        env={**os.environ, "PYTHONPATH": str(Path.cwd())},
    )
    deadline = time.monotonic() + 60
    while len(numbers := list((tmp_path / "workers").iterdir())) < 2:
        assert parent.poll() is None and time.monotonic() < deadline
        time.sleep(0.05)
    workers = [psutil.Process(int(path.name)) for path in numbers]
    parent.kill()
    parent.wait()
    assert psutil.wait_procs(workers, timeout=30)[1] == []


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Start two workers whose working folder is another one."""
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    with pytest.MonkeyPatch.context() as patch:
        path = os.pathsep.join([str(Path.cwd()), os.environ.get("PYTHONPATH", "")])
        patch.setenv("PYTHONPATH", path)
        patch.chdir(tmp_path_factory.mktemp("workers"))
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
        ) as cluster:
            yield cluster


def slowly(folder: Path, number: int) -> int:
    """Write the number of this process to a folder, and take a while."""
    (folder / f"{os.getpid()}").touch()
    time.sleep(0.2)
    return number * number


def test_ingest_on_a_cluster_leaves_the_bytes_of_one_process(tmp_path, monkeypatch, cluster):
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text(PARAMS)
    Path("raw").mkdir()
    for number in range(1, 12):
        write(Path("raw"), number, bodies(number))
    Path("raw/S001C001P001R002A050.skeleton").write_text("20\nno bodies\n")

    def ingested(out: str) -> dict[str, bytes]:
        ingest(Path("raw"), Path(out), Path(f"{out}.json"))
        return {path.name: path.read_bytes() for path in Path(out).iterdir()}

    alone = ingested("alone")
    monkeypatch.setenv(SCHEDULER, cluster.scheduler_address)
    assert ingested("together") == alone and len(alone) == 3


def test_augment_on_a_cluster_leaves_the_bytes_of_one_process(tmp_path, monkeypatch, cluster):
    monkeypatch.chdir(tmp_path)
    lay_out(tmp_path, {f"clip{number}": source(number) for number in range(3)})
    found = {}
    for cache, address in (("alone", ""), ("together", cluster.scheduler_address)):
        monkeypatch.setenv(SCHEDULER, address)
        monkeypatch.setattr("sys.argv", ["augment", f"--cache={cache}", *COMMAND[1:]])
        augment(arguments())
        found[cache] = result(tmp_path)
    assert found["alone"] == found["together"]


@pytest.mark.parametrize("order", ["map_unordered", "map_ordered"])
def test_what_a_dead_worker_had_in_hand_is_done_again(tmp_path, cluster, order):
    with open_executor(cluster.scheduler_address) as used:
        results = getattr(used, order)(partial(slowly, tmp_path), range(30))
        first = next(results)
        os.kill(int(next(tmp_path.iterdir()).name), signal.SIGKILL)
        assert sorted([first, *results]) == [number * number for number in range(30)]


def test_a_worker_with_other_code_is_refused():
    with pytest.raises(RuntimeError, match="other code"):
        read_on_worker("other", None, None)


def test_a_failure_on_a_worker_is_the_callers(tmp_path, cluster):
    with open_executor(cluster.scheduler_address) as used, pytest.raises(FileNotFoundError):
        list(used.map_ordered(Path.read_text, [tmp_path / "none"]))
