"""Truth: a variation made alone, byte for byte; equal bytes are what may be kept and reused."""

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
    trunk_deformation,
)
from pacmo_core.augmentation.segments import segments
from pacmo_core.data.skeleton import NTU25
from pacmo_core.interaction_mesh import MAX_BATCH
from tests.augmentation.real_windows import salsa_window
from tests.augmentation.sources import SETTINGS, batch, bodies, flat_source, source
from tests.docs import ROOT


def bytes_of(made: SolvedVariation) -> tuple[bytes, dict[str, float]]:
    return made.motions.tobytes(), made.measurements


def part(whole: Batch, rows: list[int]) -> Batch:
    return replace(
        whole, scales=whole.scales[rows], body_keys=tuple(whole.body_keys[r] for r in rows)
    )


def check_company(whole: Batch, companies: list[list[int]]) -> None:
    together = {name: bytes_of(made) for name, made in solve_batch(whole).variations.items()}
    for rows in companies:
        own = solve_batch(part(whole, rows)).variations
        assert {n: bytes_of(m) for n, m in own.items()} == {n: together[n] for n in own}
        assert len(own) == len(rows)


def test_a_variation_is_the_same_bytes_whatever_is_made_with_it() -> None:
    # Enough for two batches, and bodies of several attempts of the ladder.
    whole = batch(bodies(MAX_BATCH + 7))
    made = solve_batch(whole).variations
    assert len({m.measurements["attempt"] for m in made.values()}) > 1
    odd = np.random.default_rng(1).permutation(len(whole.body_keys)).tolist()
    check_company(whole, [[3], [0], [52, 2], odd[:17], odd[17:40], odd])


@pytest.mark.slow
def test_that_holds_on_a_real_window_too() -> None:
    window = salsa_window(n_frames=61)
    random = np.random.default_rng(2)
    scales = np.ones((20, 52))
    scales[np.arange(20), random.integers(0, 52, 20)] = random.uniform(0.75, 1.25, 20)
    scales[:4, :26] = np.array([[0.75], [0.9], [1.1], [1.25]])
    names = tuple(f"{row:02d}" for row in range(20))
    whole = Batch(source_key(window), solver_key(SETTINGS), window, SETTINGS, scales, names)
    check_company(whole, [[0], [19], [1, 7, 13], list(range(10, 20))])


def test_the_next_lot_of_another_source_or_settings_does_not_get_the_last_ones() -> None:
    one, two = batch(bodies(2)), batch(bodies(2), seed=1)
    first = [bytes_of(m) for m in solve_batch(one).variations.values()]
    assert [bytes_of(m) for m in solve_batch(two).variations.values()] != first
    assert [bytes_of(m) for m in solve_batch(one).variations.values()] == first
    settings = replace(SETTINGS, relaxation=1.2)
    other = replace(one, settings=settings, solver_key=solver_key(settings))
    assert [bytes_of(m) for m in solve_batch(other).variations.values()] != first


def test_motions_are_of_the_bodies_that_were_asked_for() -> None:
    own, scales = source(), bodies(3)
    made = list(solve_batch(batch(scales)).variations.values())
    parent, child = own.skeleton.bones.T
    for row, one in zip(scales, made, strict=True):
        for person, motion, part_of in zip(
            (own.person_a, own.person_b), one.motions, np.split(row, 2), strict=True
        ):
            before, after = (
                np.linalg.norm(m[:, child] - m[:, parent], axis=-1) for m in (person, motion)
            )
            np.testing.assert_allclose(after, part_of * before, rtol=2e-6)


def test_a_source_that_the_solver_refuses_is_an_outcome_with_its_reason() -> None:
    outcome = solve_batch(batch(bodies(2), own=flat_source()))
    assert outcome.variations == {}
    assert "person_b is flat" in outcome.error


def test_a_worker_of_other_code_is_found_out() -> None:
    with pytest.raises(RuntimeError, match="this worker runs other code, NumPy or SciPy"):
        solve_batch(replace(batch(bodies(1)), solver_key="another"))


def test_what_a_variation_rests_on_is_in_its_hashes() -> None:
    own = source()
    assert source_key(own) == source_key(source())
    moved = replace(own, person_b=own.person_b + np.float32(1e-6))
    renamed = replace(own, skeleton=replace(own.skeleton, name="other"))
    slower = replace(own, times=own.times * 2)
    assert source_key(renamed) == source_key(own)
    assert len({source_key(x) for x in (own, moved, slower, own.swapped())}) == 4
    assert solver_key(SETTINGS) != solver_key(replace(SETTINGS, contact_slack=0.03))
    ones = np.ones(5)
    assert body_key((ones, ones)) != body_key((ones, np.nextafter(ones, 2)))


# FROM """Truth: the same batches, solved one after the other in this process."""
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
def test_processes_side_by_side_give_what_one_gives() -> None:
    batches = [batch(bodies(3, seed), seed) for seed in range(5)]
    batches.append(batch(bodies(2), own=flat_source()))
    assert comparable(list(solve_with_processes(batches, processes=2))) == comparable(
        [solve_batch(one) for one in batches]
    )


@pytest.mark.slow
def test_the_number_of_blas_threads_leaves_no_trace() -> None:
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


def test_no_lots_start_no_process() -> None:
    assert list(solve_with_processes([], processes=2)) == []


@pytest.mark.slow
def test_processes_die_with_the_one_that_started_them() -> None:
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
def test_a_cluster_gives_what_one_process_gives() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    batches = [batch(bodies(3, seed), seed) for seed in range(4)]
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, processes=True
    ) as cluster:
        found = list(solve_on_cluster(batches, cluster.scheduler_address))
    assert comparable(found) == comparable([solve_batch(one) for one in batches])


def test_a_cluster_without_its_package_says_which_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ModuleNotFoundError, match="distributed"):
        list(solve_on_cluster([batch(bodies(1))], "tcp://127.0.0.1:1"))


# FROM """Truth: bodies bent by hand."""
def standing() -> np.ndarray:
    """Give a Kinect body, (5, 25, 3), that stands and walks ahead."""
    random = np.random.default_rng(0)
    pose = random.uniform(-0.5, 0.5, (25, 3))
    places = {"spine_base": 0.9, "spine_mid": 1.1, "spine_shoulder": 1.3}
    for name, height in places.items():
        pose[NTU25.joints.index(name)] = [0, height, 0]
    for side, sign in (("left", 1), ("right", -1)):
        pose[NTU25.joints.index(f"{side}_hip")] = [0.15 * sign, 0.9, 0]
        pose[NTU25.joints.index(f"{side}_shoulder")] = [0.2 * sign, 1.3, 0]
    return (pose + np.linspace(0, 1, 5)[:, None, None] * [0, 0, 1]).astype(np.float32)


def test_a_body_that_is_scaled_in_place_has_not_changed() -> None:
    body = standing()
    assert trunk_deformation(body, body, NTU25, np.ones(24)) == pytest.approx(0, abs=1e-6)
    assert trunk_deformation(body, 0.8 * body, NTU25, np.full(24, 0.8)) == pytest.approx(
        0, abs=1e-6
    )


def test_hips_that_fold_are_seen_and_arms_that_reach_are_not() -> None:
    body = standing()
    folded, reaching = body.copy(), body.copy()
    for side in ("left", "right"):
        # Bones of the same length, forwards: the hips are 0 apart instead of 0.3.
        folded[:, NTU25.joints.index(f"{side}_hip")] = body[:, 0] + np.float32([0, 0, 0.15])
        for joint in ("elbow", "wrist", "hand"):
            reaching[:, NTU25.joints.index(f"{side}_{joint}")] += 0.3
    reaching[:, NTU25.joints.index("head")] += 0.2
    assert trunk_deformation(body, folded, NTU25, np.ones(24)) == pytest.approx(1, abs=1e-6)
    assert trunk_deformation(body, reaching, NTU25, np.ones(24)) == pytest.approx(0, abs=1e-6)


def test_a_longer_spine_is_what_was_asked_for() -> None:
    body = standing()
    longer, scales = body.copy(), np.ones(24)
    for row, segment in enumerate(segments(NTU25)):
        if segment.name == "spine_mid":
            scales[row] = 1.5
    legs = ("spine_base", "hip", "knee", "ankle", "foot")
    for joint, name in enumerate(NTU25.joints):
        if not name.endswith(legs):
            longer[:, joint, 1] += 0.1
    assert trunk_deformation(body, longer, NTU25, scales) == pytest.approx(0, abs=1e-6)
    assert trunk_deformation(body, longer, NTU25, np.ones(24)) > 0.2
