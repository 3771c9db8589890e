"""Reference: a variation solved alone, byte for byte; batches solved one by one in this process."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import psutil
import pytest

from pacmo_core.augmentation.run import (
    Batch,
    BatchResult,
    SolvedVariation,
    body_key,
    solve_batch,
    solve_on_cluster,
    solve_with_processes,
    solver_key,
    source_key,
)
from pacmo_core.augmentation.solutions import OWN_WEIGHTS
from pacmo_core.interaction_mesh import MAX_BATCH
from tests.augmentation.real_windows import salsa_window
from tests.augmentation.sources import SETTINGS, batch, bodies, flat_source, source
from tests.docs import ROOT


def bytes_of(solved: SolvedVariation) -> tuple[bytes, dict[str, float]]:
    return solved.motions.tobytes(), solved.measurements


def part(whole: Batch, rows: list[int]) -> Batch:
    return replace(
        whole, scales=whole.scales[rows], body_keys=tuple(whole.body_keys[r] for r in rows)
    )


def check_batches_are_independent(whole: Batch, selections: list[list[int]]) -> None:
    all_at_once = {name: bytes_of(solved) for name, solved in solve_batch(whole).variations.items()}
    for rows in selections:
        alone = solve_batch(part(whole, rows)).variations
        assert {n: bytes_of(m) for n, m in alone.items()} == {n: all_at_once[n] for n in alone}
        assert len(alone) == len(rows)


def test_a_variation_has_the_same_bytes_in_any_batch() -> None:
    # Enough for two batches, and bodies that need several attempts.
    whole = batch(bodies(MAX_BATCH + 7))
    solved = solve_batch(whole).variations
    assert len({m.measurements["attempt"] for m in solved.values()}) > 1
    order = np.random.default_rng(1).permutation(len(whole.body_keys)).tolist()
    check_batches_are_independent(whole, [[3], [0], [52, 2], order[:17], order[17:40], order])


@pytest.mark.slow
def test_a_variation_of_a_real_window_has_the_same_bytes_in_any_batch() -> None:
    window = salsa_window(n_frames=61)
    random = np.random.default_rng(2)
    scales = np.ones((20, 52))
    scales[np.arange(20), random.integers(0, 52, 20)] = random.uniform(0.75, 1.25, 20)
    scales[:4, :26] = np.array([[0.75], [0.9], [1.1], [1.25]])
    names = tuple(f"{row:02d}" for row in range(20))
    whole = Batch(source_key(window), solver_key(SETTINGS), window, SETTINGS, scales, names)
    check_batches_are_independent(whole, [[0], [19], [1, 7, 13], list(range(10, 20))])


def test_a_batch_of_another_source_or_settings_does_not_use_the_last_factorisation() -> None:
    one, two = batch(bodies(2)), batch(bodies(2), seed=1)
    first_bytes = [bytes_of(m) for m in solve_batch(one).variations.values()]
    assert [bytes_of(m) for m in solve_batch(two).variations.values()] != first_bytes
    assert [bytes_of(m) for m in solve_batch(one).variations.values()] == first_bytes
    settings = replace(SETTINGS, floor_penalty=2 * SETTINGS.floor_penalty)
    other = replace(one, settings=settings, solver_key=solver_key(settings))
    assert [bytes_of(m) for m in solve_batch(other).variations.values()] != first_bytes


def test_motions_have_the_target_bone_lengths() -> None:
    interaction, scales = source(), bodies(3)
    solved = list(solve_batch(batch(scales)).variations.values())
    parent, child = interaction.skeleton.bones.T
    for row, one in zip(scales, solved, strict=True):
        for person, motion, bone_scales in zip(
            (interaction.person_a, interaction.person_b), one.motions, np.split(row, 2), strict=True
        ):
            before, after = (
                np.linalg.norm(m[:, child] - m[:, parent], axis=-1) for m in (person, motion)
            )
            np.testing.assert_allclose(after, bone_scales * before, rtol=2e-6)


def test_a_source_that_the_solver_refuses_gives_an_error() -> None:
    outcome = solve_batch(batch(bodies(2), interaction=flat_source()))
    assert outcome.variations == {}
    assert "person_b is flat" in outcome.error


def test_a_worker_of_other_code_is_refused() -> None:
    with pytest.raises(RuntimeError, match="this worker runs other code, NumPy or SciPy"):
        solve_batch(replace(batch(bodies(1)), solver_key="another"))


def test_the_hashes_depend_on_source_bodies_and_settings() -> None:
    interaction = source()
    assert source_key(interaction) == source_key(source())
    moved = replace(interaction, person_b=interaction.person_b + np.float32(1e-6))
    renamed = replace(interaction, skeleton=replace(interaction.skeleton, name="other"))
    slower = replace(interaction, times=interaction.times * 2)
    assert source_key(renamed) == source_key(interaction)
    assert len({source_key(x) for x in (interaction, moved, slower, interaction.swapped())}) == 4
    assert solver_key(SETTINGS) != solver_key(replace(SETTINGS, contact_slack=0.03))
    ones = np.ones(5)
    assert body_key((ones, ones), OWN_WEIGHTS) != body_key(
        (ones, np.nextafter(ones, 2)), OWN_WEIGHTS
    )


def comparable(outcomes: list[BatchResult]) -> list[tuple]:
    return sorted(
        (
            o.source_key,
            o.error,
            [(n, m.motions.tobytes(), m.measurements) for n, m in o.variations.items()],
        )
        for o in outcomes
    )


@pytest.mark.slow
def test_several_processes_give_the_results_of_one() -> None:
    batches = [batch(bodies(3, seed), seed) for seed in range(5)]
    batches.append(batch(bodies(2), interaction=flat_source()))
    assert comparable(list(solve_with_processes(batches, processes=2))) == comparable(
        [solve_batch(one) for one in batches]
    )


@pytest.mark.slow
def test_the_number_of_blas_threads_does_not_change_bytes() -> None:
    program = (
        "from hashlib import sha256\n"
        "from pacmo_core.augmentation.run import solve_batch\n"
        "from tests.augmentation.sources import bodies, batch\n"
        "made = solve_batch(batch(bodies(3, 1), 1)).variations\n"
        "print(sha256(b''.join(one.motions.tobytes() for one in made.values())).hexdigest())\n"
    )

    def printed(n_threads: str) -> str:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": n_threads}
        command = [sys.executable, "-c", program]
        return subprocess.check_output(command, env=environment, cwd=ROOT, text=True)

    assert printed("1") == printed("2")


def test_no_batches_give_no_results() -> None:
    assert list(solve_with_processes([], processes=2)) == []


@pytest.mark.slow
def test_workers_end_with_the_process_that_started_them() -> None:
    program = (
        "from pacmo_core.augmentation.run import *\n"
        "from tests.augmentation.sources import bodies, batch\n"
        "if __name__ == '__main__':\n"
        "    batches = [batch(bodies(40, s), s) for s in range(400)]\n"
        "    for outcome in solve_with_processes(batches, processes=2):\n"
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
def test_a_cluster_gives_the_results_of_one_process() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    batches = [batch(bodies(3, seed), seed) for seed in range(4)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        results = list(solve_on_cluster(batches, cluster.scheduler_address))
    assert comparable(results) == comparable([solve_batch(one) for one in batches])


def test_a_cluster_without_its_package_says_which_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ModuleNotFoundError, match="distributed"):
        list(solve_on_cluster([batch(bodies(1))], "tcp://127.0.0.1:1"))
