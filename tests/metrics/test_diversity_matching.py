"""Trusted: picking among rivals drawn at random, many times, and what a blind guess gives."""

import numpy as np
import pytest

from pacmo_core.metrics.diversity import matching_accuracy, n_candidates
from tests.metrics.problems import unit


def embedded(n, closeness, rng):
    partner = unit(rng.normal(size=(n, 3)))
    return np.stack([partner, unit(partner + rng.normal(size=(n, 3)) / closeness)])


def test_the_share_is_that_of_rivals_drawn_at_random():
    rng = np.random.default_rng(0)
    both, codes = embedded(16, 2.0, rng), np.arange(16) // 2
    found = matching_accuracy(both, codes, np.ones((1, 8)), candidates=5)[0]
    fit = both[1] @ both[0].T
    hits = [
        fit[i, i] > fit[i, rng.choice(np.flatnonzero(codes != codes[i]), 4, replace=False)].max()
        for i in range(16)
        for _ in range(1000)
    ]
    assert found == pytest.approx(np.mean(hits), abs=0.015)
    assert 0.3 < found < 0.9


def test_a_blind_matcher_guesses_and_a_perfect_one_is_always_right():
    rng = np.random.default_rng(1)
    codes, counts = np.arange(400), np.ones((1, 400))
    blind = np.stack([unit(rng.normal(size=(400, 3))) for _ in range(2)])
    assert matching_accuracy(blind, codes, counts, candidates=32)[0] == pytest.approx(
        1 / 32, abs=0.01
    )
    perfect = np.stack([blind[0], blind[0]])
    assert matching_accuracy(perfect, codes, counts, candidates=32)[0] == 1
    alike = np.ones((2, 400, 1))  # ties are no picks
    assert matching_accuracy(alike, codes, counts, candidates=32)[0] == 0


def test_the_other_person_of_a_clip_is_no_rival():
    both = np.array([[[1.0, 0], [1, 0], [0, 1], [0, 1]]] * 2)
    codes = np.array([0, 0, 1, 1])
    assert matching_accuracy(both, codes, np.ones((1, 2)), candidates=2)[0] == 1


def test_a_clip_drawn_twice_is_two_clips():
    rng = np.random.default_rng(2)
    both, codes = embedded(6, 1.0, rng), np.arange(6)
    counts = np.array([[2.0, 0, 1, 1, 1, 1]])
    kept = np.array([0, 2, 3, 4, 5])
    # Copies of the first are rivals of the others, but not of each other.
    doubled = np.concatenate([[0], kept])
    clips = np.array([0, 0, 2, 3, 4, 5])
    wanted = matching_accuracy(both[:, doubled], clips, np.ones((1, 6)), candidates=3)[0]
    assert matching_accuracy(both, codes, counts, candidates=3)[0] == pytest.approx(wanted)


def test_there_are_no_more_candidates_than_partners():
    codes = np.array([0, 0, 1, 1, 2])
    assert n_candidates(codes, 32) == 4
    assert n_candidates(codes, 3) == 3
