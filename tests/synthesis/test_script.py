"""Trusted: names are unique, a script survives JSON, and adding clips changes no clip before."""

import json

import numpy as np
import pytest

from pacmo_core.synthesis import (
    ACTIONS,
    Script,
    file_name,
    sample_interaction,
    sample_script,
    sample_scripts,
)


def _scripts(
    pairs: int, replications: int, actions: tuple[str, ...] = tuple(ACTIONS)
) -> list[Script]:
    written = sample_scripts(
        2, population=1, pairs=pairs, actions=actions, replications=replications
    )
    return [script for script, _ in written]


def test_names_are_unique_and_ntus() -> None:
    names = [file_name(script) for script in _scripts(20, 4)]
    assert len(set(names)) == 20 * 4 * len(ACTIONS)
    assert names[0] == "S001C001P001R001A059"


def test_a_script_survives_json() -> None:
    for script in _scripts(2, 1):
        assert Script.from_json(json.loads(json.dumps(script.to_json()))) == script


def test_a_script_with_a_word_missing_is_refused() -> None:
    words = _scripts(1, 1)[0].to_json()
    del words["event"]
    with pytest.raises(ValueError, match="a script has"):
        Script.from_json(words)


def test_more_pairs_actions_and_replications_change_no_clip() -> None:
    few = _scripts(2, 1, ("push", "hug"))
    many = {file_name(script): script for script in _scripts(4, 3)}
    assert [many[file_name(script)] for script in few] == few


def test_the_same_seed_gives_the_same_bytes() -> None:
    films = []
    for _ in range(2):
        written = sample_scripts(2, population=1, pairs=1, actions=tuple(ACTIONS), replications=1)
        films.append([sample_interaction(script, random) for script, random in written])
    for one, other in zip(*films, strict=True):
        assert one.person_a.tobytes() == other.person_a.tobytes()
        assert one.person_b.tobytes() == other.person_b.tobytes()


def test_clips_last_between_one_and_a_half_and_four_seconds() -> None:
    for script in _scripts(10, 2):
        assert 1.5 <= script.duration <= 4.0
        assert len(script.frame_times) == round(script.duration * 30)
        assert (np.diff(script.frame_times) > 0).all()
        assert script.frame_times[0] >= 0
        assert 0.2 < script.event <= script.event + script.hold < script.duration


@pytest.mark.parametrize(
    ("pair", "action", "replication"), [(0, "push", 1), (1, "shove", 1), (1, "push", 1000)]
)
def test_what_ntu_cannot_name_is_refused(pair: int, action: str, replication: int) -> None:
    random = np.random.default_rng(0)
    with pytest.raises(ValueError, match="wanted an action of"):
        sample_script(random, population=1, pair=pair, action=action, replication=replication)
