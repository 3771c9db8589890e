"""Truth: feet that move at known times, and a search through all sequences of states."""

from itertools import pairwise, product

import numpy as np

from pacmo_core.data.skeleton import SBU15
from pacmo_core.finish.stance import _shortest_path, find_stance, frame_runs
from tests.reaction.problems import REST
from tests.strategies import SMALL

FPS = 30.0
LEFT, RIGHT = SBU15.indices(["left_foot", "right_foot"])


def walk(fps: float = FPS, noise: float = 0.0) -> np.ndarray:
    """Stand a second, step with the left foot for half a second, stand a second."""
    times = np.arange(round(2.5 * fps)) / fps
    motion = np.tile(REST, (len(times), 1, 1))
    motion[:, LEFT, 2] += 0.6 * ((times - 1) / 0.5).clip(0, 1)
    motion += noise * np.random.default_rng(0).standard_normal(motion.shape)
    return motion.astype(np.float32)


def test_a_foot_that_steps_does_not_stand_and_the_other_does() -> None:
    for fps, noise in ((30.0, 0.0), (120.0, 0.0), (15.0, 0.0), (30.0, 0.01)):
        left, right = find_stance(walk(fps, noise), fps, SBU15)
        assert right.all()
        times = np.arange(len(left)) / fps
        assert left[times < 0.8].all() and left[times > 1.7].all()
        assert not left[(times > 1.15) & (times < 1.35)].any()


def test_the_slower_of_two_gliding_feet_stands() -> None:
    motion = walk()
    motion[:, LEFT, 2] = np.arange(len(motion)) * 0.4 / FPS
    motion[:, RIGHT, 2] = np.arange(len(motion)) * 2.0 / FPS
    left, right = find_stance(motion, FPS, SBU15)
    assert left.all() and not right.any()


def test_no_foot_stands_in_a_fast_slide() -> None:
    motion = walk()
    motion[:, :, 2] += (np.arange(len(motion)) * 3.0 / FPS)[:, None]
    assert not find_stance(motion, FPS, SBU15).any()


def test_a_skeleton_without_feet_has_no_stance() -> None:
    assert find_stance(np.zeros((5, 4, 3), np.float32), FPS, SMALL).shape == (0, 5)


def test_one_frame_has_a_stance() -> None:
    assert find_stance(walk()[:1], FPS, SBU15).all()


def test_phases_are_the_runs() -> None:
    stands = np.array([1, 1, 0, 1, 0, 0, 1], dtype=bool)
    assert frame_runs(stands) == [slice(0, 2), slice(3, 4), slice(6, 7)]


def test_the_path_is_the_best_of_all() -> None:
    random = np.random.default_rng(0)
    cost, change = random.random((6, 3)), random.random((3, 3))
    change[np.diag_indices(3)] = 0

    def total(path: tuple[int, ...]) -> float:
        steps = pairwise(path)
        return float(sum(cost[range(6), list(path)]) + sum(change[a, b] for a, b in steps))

    best = min(product(range(3), repeat=6), key=total)
    assert tuple(_shortest_path(cost, change)) == best
