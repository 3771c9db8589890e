"""Truth: the captured reaction itself, and bodies whose joints are known."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import recorded as benchmark
from benchmarks._recorded import (
    Recorded,
    _way,
    counted,
    intervals,
    most_usual,
    on_floor,
    permuted,
    pooled,
    recorded,
)
from benchmarks.blows import blows
from benchmarks.handover import handovers, measure, read_capture, still_receivers, to_object
from pacmo_core.api import synthesise
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.formats.sbu import Sbu
from pacmo_core.formats.table import Table
from pacmo_core.reaction import wgan
from pacmo_core.reaction.data import to_partner_frame
from pacmo_core.store.motions import write_motions
from pacmo_core.store.weights import write_weights
from pacmo_core.training.state import model_config, model_state
from tests.formats.real_files import real_folder
from tests.reaction import problems

JOINTS = NTU25.without(["left_hand_tip", "left_thumb", "right_hand_tip", "right_thumb"])


def scored(pairs: list[tuple[Interaction, np.ndarray]]) -> dict[str, float]:
    return pooled(pairs, counted(pairs))


@pytest.fixture(scope="module")
def handshake() -> Interaction:
    return synthesise(10)["handshake-1"]


def test_the_captured_reaction_meets_all_contacts_and_has_no_error(handshake: Interaction) -> None:
    found = scored([(handshake, handshake.person_b[None])])
    assert found.pop("reactions") == 1
    assert found == {
        "met": 1.0,
        "false": 0.0,
        "f1": 1.0,
        "hands": 1.0,
        "energy_score": 0.0,
        "ape": 0.0,
    }


def test_a_reaction_beside_the_partner_meets_nothing(handshake: Interaction) -> None:
    aside = handshake.person_b + np.array([3, 0, 0], np.float32)
    found = scored([(handshake, np.stack([aside, aside]))])
    assert found["met"] == found["f1"] == found["hands"] == 0
    apart = replace(handshake, person_b=aside)
    assert scored([(apart, handshake.person_b[None])])["false_hands"] == 1
    assert found["ape"] == pytest.approx(3, rel=1e-5) == found["energy_score"]


def test_intervals_resample_pairs_of_people_and_not_their_clips(handshake: Interaction) -> None:
    aside = handshake.person_b + np.array([3, 0, 0], np.float32)
    own, apart = handshake.person_b[None], aside[None]
    # Of four pairs two meet all contacts and two none, whatever their clips' number.
    row = counted([(handshake, own)] * 6 + [(handshake, apart)] * 2)
    rival = counted([(handshake, apart)] * 8)
    people = ["s01s02"] * 3 + ["s01s03"] * 3 + ["s02s03", "s02s04"]
    found = intervals(row, {"rival": row, "worse": rival}, people)
    assert (found["met_low"], found["met_high"]) == (0, 1)
    assert found["met_less_rival_low"] == found["met_less_rival_high"] == 0
    assert found["f1_less_worse_low"] == 0 and found["f1_less_worse_high"] == 1
    alike = intervals(row, {}, ["s01s02"] * 8)
    assert alike["met_low"] == alike["met_high"] == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("people", "others"), [("ab ab cd ab", [2, 2, 3, 2]), ("ab ab ab ab", [1, 2, 3, 0])]
)
def test_another_s_reaction_is_that_to_the_next_other_people(
    handshake: Interaction, people: str, others: list[int]
) -> None:
    """Reactions are raised by their number, partners are the same."""
    raised = [
        replace(handshake, person_b=handshake.person_b + np.array([0, number, 0], np.float32))
        for number in range(4)
    ]
    clips = [*raised, *(clip.swapped() for clip in raised)]
    found = list(permuted(clips, 2 * people.split()))
    assert len(found) == 8
    for (_, (made,)), other in zip(found, [*others, *(4 + one for one in others)], strict=True):
        np.testing.assert_allclose(made, to_partner_frame(clips[other]).person_b, atol=1e-4)


def test_both_people_are_lowered_alike(handshake: Interaction) -> None:
    up = np.array([0, 2.5, 0], np.float32)
    raised = replace(handshake, person_a=handshake.person_a + up, person_b=handshake.person_b + up)
    found, there = on_floor(raised), on_floor(handshake)
    np.testing.assert_allclose(found.person_a, there.person_a, atol=1e-5)
    np.testing.assert_allclose(found.person_b, there.person_b, atol=1e-5)


def test_who_gives_way_ends_farther_from_where_they_were_nearest() -> None:
    walk = np.concatenate([np.linspace(1.5, 0.6, 20), np.linspace(0.6, 1.0, 20), np.full(20, 1.0)])
    partner, person = np.zeros((60, 1, 3)), np.zeros((60, 1, 3))
    person[:, 0, 2] = -walk
    person[:, 0, 0] = np.linspace(0, 0.3, 60)  # aside does not count
    assert _way(partner, person) == pytest.approx(0.4, abs=1e-6)


def test_the_usual_sample_is_the_one_between_the_others() -> None:
    motions = np.zeros((4, 5, 2, 3), np.float32)
    motions[:, :, :, 0] = np.array([9.0, 0.0, 2.0, 1.0], np.float32)[:, None, None]
    assert most_usual(motions) in (2, 3)  # distances 7 + 2 + 1 and 8 + 1 + 1
    assert most_usual(motions[[0, 1, 3]]) == 2


def test_what_is_told_and_the_temperature_reach_the_reactions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clips = problems.clips(4)
    settings = replace(problems.PACMO_LONG, n_epochs=2, action_channels=2, action_dropout=0.5)
    labels = ["A055 hug", "A058 shake hands"] * 2
    model = wgan.build_training(clips, settings, actions=labels).finish()
    weights = tmp_path / "weights.safetensors"
    write_weights(weights, {"model": "pacmo", "config": model_config(model)}, model_state(model))
    sets = {"sbu": Recorded({"hugging": clips}, {"hugging": ["ab", "cd", "ef", "gh"]}, [], {})}
    monkeypatch.setattr(benchmark, "recorded", lambda *_: sets)

    def scores(*words: object) -> dict[str, float]:
        monkeypatch.setattr(sys, "argv", ["recorded", *map(str, words), "--json"])
        benchmark.main()
        found: dict[str, float] = json.loads(capsys.readouterr().out.splitlines()[-1])
        return found

    of_four = ["--weights", weights, "--samples", 4]
    untold, told = scores(*of_four), scores(*of_four, "--told")
    assert not any(key.startswith("told_") for key in untold)
    assert {key: told[key] for key in untold} == untold
    assert told["told_sbu_energy_score"] != untold["sbu_energy_score"]
    # Without noise four samples are one reaction, whose energy score is its error.
    cold = [scores(*of_four[:3], n, "--temperature", 0)["sbu_energy_score"] for n in (1, 4)]
    assert cold[0] == pytest.approx(cold[1], rel=1e-5)
    assert cold[1] > untold["sbu_energy_score"]


def test_every_act_of_sbu_and_the_couples_are_read() -> None:
    real_folder("sbu")
    sets = recorded(JOINTS, Sbu(fps=15))
    sbu = sets["sbu"]
    assert (
        len(sbu.acts) == 8 and sum(map(len, sbu.acts.values())) == 564 and len(sbu.handshakes) == 36
    )
    assert len(sbu.pairs_of_people) == 564 and len(set(sbu.pairs_of_people)) == 13
    # About one of the two gives way in each of 135 blows.
    assert sum(map(len, sbu.blows.values())) == 114
    real_folder("cmu_18_19")
    real_folder("handover")
    (takes,) = sets["cmu"].acts.values()
    assert len(takes) == 18 and len(sets["cmu"].handshakes) == 2 and not sets["cmu"].blows
    (handovers,) = sets["handover"].acts.values()
    assert len(handovers) == 200 and not sets["handover"].handshakes


def test_a_receiver_who_is_moved_aside_misses_the_object_by_as_much(tmp_path: Path) -> None:
    folder = real_folder("handover")
    sequence = next(s for s in Table().find(folder) if s.name == "variation_0")
    clip = Table().read(sequence).interaction
    file, way = tmp_path / "motions.parquet", np.array([0, 0, 2.0], np.float32)
    with write_motions(file, clip.skeleton) as writer:
        writer.add("variation_0#a#0", replace(clip, person_b=clip.person_a))
        writer.add("variation_0#b#0", clip)
        writer.add("variation_0#b#1", replace(clip, person_b=clip.person_b + way))
    (itself, unmoved), (captured, aside) = measure(file)
    assert itself == captured
    assert vars(unmoved) == pytest.approx(vars(itself), abs=1e-5)
    assert itself.hand < 0.15 and itself.root == 0
    assert aside.root == pytest.approx(2, abs=1e-5)
    assert 2 - itself.hand - 0.7 < aside.hand < 2 + itself.hand, "hands are 0.7 m apart at most"


def test_who_stands_still_is_where_the_others_stood_and_reaches_less_often_than_they_did() -> None:
    real_folder("handover")
    still = still_receivers()
    captured = [read_capture(file) for file in handovers("variation_*.npz")]
    assert len(still) == len(captured)
    near = np.mean([reach.hand < 0.15 for reach in still])
    taken = [
        to_object(one.joints, one.receiver, one.place)[one.transfer] < 0.15 for one in captured
    ]
    assert 0 < near < np.mean(taken)
    assert np.median([reach.root for reach in still]) < 0.5


def test_a_blow_that_lands_a_tenth_of_a_second_late_is_met_and_a_later_one_is_not() -> None:
    push = synthesise(10)["push-1"]
    times = np.arange(len(push.times)) / 30
    push = replace(push, times=times)
    n_met, n_frames = blows(push, push)
    assert n_met == n_frames > 0
    late = [replace(push, person_a=np.roll(push.person_a, lag, 0),
                    person_b=np.roll(push.person_b, lag, 0)) for lag in (3, 12)]  # fmt: skip
    assert blows(push, late[0]) == (n_frames, n_frames)
    assert blows(push, late[1])[0] < n_frames
