"""What is trusted: what one process gives; a real Dask cluster of two workers on this machine."""

import os
import signal
import time
from functools import partial
from pathlib import Path

import pytest

from pacmo_core.execution import DaskExecutor
from pacmo_core.ingestion import read_on_worker
from stages.augment import arguments
from stages.augment import main as augment
from stages.common.files import SCHEDULER
from stages.ingest import main as ingest
from tests.augmentation.sources import source
from tests.stages.augmenting import COMMAND, lay_out, result
from tests.test_ingestion import bodies, write
from tests.test_reading_cache import PARAMS

distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """Start two workers that stand in another folder."""
    with pytest.MonkeyPatch.context() as patch:
        path = os.pathsep.join([str(Path.cwd()), os.environ.get("PYTHONPATH", "")])
        patch.setenv("PYTHONPATH", path)
        patch.chdir(tmp_path_factory.mktemp("workers"))
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
        ) as found:
            yield found


def slowly(folder: Path, number: int) -> int:
    """Say who has begun, and take a while."""
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
    with DaskExecutor(cluster.scheduler_address) as used:
        results = getattr(used, order)(partial(slowly, tmp_path), range(30))
        first = next(results)
        os.kill(int(next(tmp_path.iterdir()).name), signal.SIGKILL)
        assert sorted([first, *results]) == [number * number for number in range(30)]


def test_a_worker_with_other_code_is_refused():
    with pytest.raises(RuntimeError, match="other code"):
        read_on_worker("other", None, None)


def test_a_failure_on_a_worker_is_the_callers(tmp_path, cluster):
    with DaskExecutor(cluster.scheduler_address) as used, pytest.raises(FileNotFoundError):
        list(used.map_ordered(Path.read_text, [tmp_path / "none"]))
