"""Truth: the same lots, solved one after the other in this process."""

import os
import subprocess
import sys

import psutil
import pytest

from pacmo_core.augmentation.solve import Outcome, solve
from pacmo_core.augmentation.workers import solve_on_cluster, solve_side_by_side
from tests.augmentation.sources import bodies, flat_source, lot
from tests.docs import ROOT


def comparable(outcomes: list[Outcome]) -> list[tuple]:
    return sorted(
        (o.key, o.refused, [(n, m.motions.tobytes(), m.figures) for n, m in o.made.items()])
        for o in outcomes
    )


@pytest.mark.slow
def test_processes_side_by_side_give_what_one_gives() -> None:
    lots = [lot(bodies(3, seed), seed) for seed in range(5)]
    lots.append(lot(bodies(2), own=flat_source()))
    assert comparable(list(solve_side_by_side(lots, processes=2))) == comparable(
        [solve(one) for one in lots]
    )


@pytest.mark.slow
def test_the_number_of_blas_threads_leaves_no_trace() -> None:
    program = (
        "from hashlib import sha256\n"
        "from pacmo_core.augmentation.solve import solve\n"
        "from tests.augmentation.sources import bodies, lot\n"
        "made = solve(lot(bodies(3, 1), 1)).made\n"
        "print(sha256(b''.join(one.motions.tobytes() for one in made.values())).hexdigest())\n"
    )

    def printed(n_threads: str) -> str:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": n_threads}
        command = [sys.executable, "-c", program]
        return subprocess.check_output(command, env=environment, cwd=ROOT, text=True)

    assert printed("1") == printed("2")


def test_no_lots_start_no_process() -> None:
    assert list(solve_side_by_side([], processes=2)) == []


@pytest.mark.slow
def test_processes_die_with_the_one_that_started_them() -> None:
    program = (
        "from pacmo_core.augmentation.workers import *\n"
        "from tests.augmentation.sources import bodies, lot\n"
        "if __name__ == '__main__':\n"
        "    lots = [lot(bodies(40, s), s) for s in range(400)]\n"
        "    for outcome in solve_side_by_side(lots, processes=2):\n"
        "        print('one', flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as running:
        running.stdout.readline()
        children = psutil.Process(running.pid).children(recursive=True)
        assert len(children) >= 2
        running.kill()
    _, alive = psutil.wait_procs(children, timeout=20)
    assert alive == []


@pytest.mark.slow
def test_a_cluster_gives_what_one_process_gives() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    lots = [lot(bodies(3, seed), seed) for seed in range(4)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        found = list(solve_on_cluster(lots, cluster.scheduler_address))
    assert comparable(found) == comparable([solve(one) for one in lots])


def test_a_cluster_without_its_package_says_which_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ModuleNotFoundError, match="distributed"):
        list(solve_on_cluster([lot(bodies(1))], "tcp://127.0.0.1:1"))
