"""Truth: a variation made alone, byte for byte; equal bytes are what may be kept and reused."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.augmentation.keys import body_key, maker_key, source_key
from pacmo_core.augmentation.solve import Lot, Made, solve
from pacmo_core.interaction_mesh import BATCH
from tests.augmentation.real_windows import salsa_window
from tests.augmentation.sources import SETTINGS, bodies, flat_source, lot, source


def bytes_of(made: Made) -> tuple[bytes, dict[str, float]]:
    return made.motions.tobytes(), made.figures


def part(whole: Lot, rows: list[int]) -> Lot:
    return replace(whole, scales=whole.scales[rows], names=tuple(whole.names[r] for r in rows))


def check_company(whole: Lot, companies: list[list[int]]) -> None:
    together = {name: bytes_of(made) for name, made in solve(whole).made.items()}
    for rows in companies:
        own = solve(part(whole, rows)).made
        assert {n: bytes_of(m) for n, m in own.items()} == {n: together[n] for n in own}
        assert len(own) == len(rows)


def test_a_variation_is_the_same_bytes_whatever_is_made_with_it() -> None:
    # Enough for two batches, and bodies of several rungs of the ladder.
    whole = lot(bodies(BATCH + 7))
    made = solve(whole).made
    assert len({m.figures["rung"] for m in made.values()}) > 1
    odd = np.random.default_rng(1).permutation(len(whole.names)).tolist()
    check_company(whole, [[3], [0], [52, 2], odd[:17], odd[17:40], odd])


@pytest.mark.slow
def test_that_holds_on_a_real_window_too() -> None:
    window = salsa_window(n_frames=61)
    random = np.random.default_rng(2)
    scales = np.ones((20, 52))
    scales[np.arange(20), random.integers(0, 52, 20)] = random.uniform(0.75, 1.25, 20)
    scales[:4, :26] = np.array([[0.75], [0.9], [1.1], [1.25]])
    names = tuple(f"{row:02d}" for row in range(20))
    whole = Lot(source_key(window), maker_key(SETTINGS), window, SETTINGS, scales, names)
    check_company(whole, [[0], [19], [1, 7, 13], list(range(10, 20))])


def test_the_next_lot_of_another_source_or_settings_does_not_get_the_last_ones() -> None:
    one, two = lot(bodies(2)), lot(bodies(2), seed=1)
    first = [bytes_of(m) for m in solve(one).made.values()]
    assert [bytes_of(m) for m in solve(two).made.values()] != first
    assert [bytes_of(m) for m in solve(one).made.values()] == first
    settings = replace(SETTINGS, relaxation=1.2)
    other = replace(one, settings=settings, maker=maker_key(settings))
    assert [bytes_of(m) for m in solve(other).made.values()] != first


def test_motions_are_of_the_bodies_that_were_asked_for() -> None:
    own, scales = source(), bodies(3)
    made = list(solve(lot(scales)).made.values())
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
    outcome = solve(lot(bodies(2), own=flat_source()))
    assert outcome.made == {}
    assert "person_b is flat" in outcome.refused


def test_a_worker_of_other_code_is_found_out() -> None:
    with pytest.raises(RuntimeError, match="this worker has other code, NumPy or SciPy"):
        solve(replace(lot(bodies(1)), maker="another"))


def test_what_a_variation_rests_on_is_in_its_hashes() -> None:
    own = source()
    assert source_key(own) == source_key(source())
    moved = replace(own, person_b=own.person_b + np.float32(1e-6))
    renamed = replace(own, skeleton=replace(own.skeleton, name="other"))
    slower = replace(own, times=own.times * 2)
    assert source_key(renamed) == source_key(own)
    assert len({source_key(x) for x in (own, moved, slower, own.swapped())}) == 4
    assert maker_key(SETTINGS) != maker_key(replace(SETTINGS, slack=0.03))
    ones = np.ones(5)
    assert body_key((ones, ones)) != body_key((ones, np.nextafter(ones, 2)))
