"""Trusted: the distribution. Given the script both are independent: a new sample is exact."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from pacmo_core.synthesis import (
    ACTIONS,
    sample_interaction,
    sample_motion,
    sample_oracle_reaction,
    sample_scripts,
)
from pacmo_core.synthesis.script import Role, Script
from tests.synthesis.clips import JOINT, POPULATION

PAIRS, REPLICATIONS = 20, 2


def _shoot(actions: tuple[str, ...]) -> list[tuple[Script, np.random.Generator]]:
    shoot = sample_scripts(
        31, population=POPULATION, pairs=PAIRS, actions=actions, replications=REPLICATIONS
    )
    return list(shoot)


def _facts(script: Script, partner: NDArray[np.float32], own: NDArray[np.float32]) -> list[float]:
    """Give some figures of a reaction, alone and against the partner."""
    after = min(int(30 * (script.event + 0.5)), len(own) - 1)
    spine = own[:, JOINT["spine_shoulder"]]
    speed = np.linalg.norm(np.diff(spine, axis=0), axis=-1)
    return [
        float(np.linalg.norm(own[-1, 0] - own[0, 0])),
        float(speed.argmax() / 30 - script.event),
        float(own[after, JOINT["left_hand"], 1] - own[after, 0, 1]),
        float(own[after, JOINT["right_hand"], 1] - own[after, 0, 1]),
        float(np.linalg.norm(own[-1, 0] - partner[-1, 0])),
        float(np.linalg.norm(own[after, JOINT["head"]] - partner[after, JOINT["right_hand"]])),
    ]


@pytest.mark.parametrize("action", list(ACTIONS))
def test_the_oracle_with_the_generator_of_the_reaction_is_the_reaction(action: str) -> None:
    script, _ = _shoot((action,))[0]
    real = sample_interaction(script, np.random.default_rng([1, 2]))
    for_a, for_b = np.random.default_rng([1, 2]).spawn(2)
    assert np.array_equal(real.person_a, sample_oracle_reaction(script, "a", for_a))
    assert np.array_equal(real.person_b, sample_oracle_reaction(script, "b", for_b))


def test_a_new_sample_of_one_person_leaves_the_other_unchanged() -> None:
    script, _ = _shoot(("push",))[0]
    for role in ("a", "b"):
        kept, other = np.random.default_rng(4), np.random.default_rng(4)
        first = sample_motion(script, kept, role)
        sample_motion(script, np.random.default_rng(99), "b" if role == "a" else "a")
        assert np.array_equal(first, sample_motion(script, other, role))
        assert not np.array_equal(first, sample_motion(script, other, role))


def _role(script: Script, part: str) -> Role:
    other: Role = "b" if script.initiator == "a" else "a"
    return script.initiator if part == "initiator" else other


@pytest.mark.slow
@pytest.mark.parametrize("part", ["initiator", "other"])
def test_oracle_samples_and_real_reactions_have_one_distribution(part: str) -> None:
    real, drawn = [], []
    for index, (script, random) in enumerate(_shoot(tuple(ACTIONS))):
        role = _role(script, part)
        both = sample_interaction(script, random)
        partner, own = (both.person_b, both.person_a)[:: 1 if role == "a" else -1]
        fresh = sample_oracle_reaction(script, role, np.random.default_rng([5, index]))
        real.append(_facts(script, partner, own))
        drawn.append(_facts(script, partner, fresh))
    for one, other in zip(np.transpose(real), np.transpose(drawn), strict=True):
        assert stats.ks_2samp(one, other).pvalue > 0.02
        # Both have the same script: a sign test is sharper than a test of the whole distribution.
        assert stats.wilcoxon(one - other).pvalue > 0.005


@pytest.mark.slow
def test_given_the_script_the_two_people_are_independent() -> None:
    script, _ = _shoot(("push",))[0]
    draws = [sample_interaction(script, np.random.default_rng([6, k])) for k in range(150)]
    a = np.array([_facts(script, d.person_b, d.person_a)[:4] for d in draws])
    b = np.array([_facts(script, d.person_a, d.person_b)[:4] for d in draws])
    table = stats.spearmanr(a, b).statistic[:4, 4:]
    assert np.abs(table).max() < 3.6 / np.sqrt(len(draws))


def test_the_script_binds_the_two_together() -> None:
    late = []
    for index, (script, _) in enumerate(_shoot(("push",))):
        pushed = sample_motion(script, np.random.default_rng([7, index]), _role(script, "other"))
        chest = pushed[int(30 * (script.event - 0.15)) :, JOINT["spine_shoulder"]]
        late.append(np.linalg.norm(chest[3:] - chest[:-3], axis=-1).argmax() / 30 + 0.05 - 0.15)
    # The chest of who is pushed moves fastest soon after the hands reach it, and never before.
    assert min(late) > 0.0
    assert np.median(late) < 0.45


@pytest.mark.parametrize(("action", "joint"), [("depart", "left_hip"), ("kick", "head")])
def test_a_reaction_has_more_than_one_mode(action: str, joint: str) -> None:
    script, _ = _shoot((action,))[0]
    role = _role(script, "other")
    draws = np.stack(
        [sample_motion(script, np.random.default_rng([8, k]), role) for k in range(120)]
    )
    frame = min(int(30 * (script.event + 0.75)), draws.shape[1] - 1)
    place = draws[:, frame, JOINT[joint]]
    centred = place - place.mean(axis=0)
    main = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    # Two clusters cut along the first axis explain most of a spread that one normal would not.
    cut = np.sort(main)
    within = min(cut[:k].var() * k + cut[k:].var() * (len(cut) - k) for k in range(10, 111))
    assert within / (main.var() * len(main)) < 1 - 2 / np.pi


def test_two_samples_differ_far_beyond_the_cameras_error() -> None:
    for action in ACTIONS:
        script, _ = _shoot((action,))[0]
        draws = [sample_motion(script, np.random.default_rng([9, k]), "b") for k in range(12)]
        spread = np.std(draws, axis=0)
        assert np.linalg.norm(spread, axis=-1).mean() > 0.025, action
