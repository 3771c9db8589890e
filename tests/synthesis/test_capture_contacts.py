"""Trusted: an action is what its name says: hands meet, blows land, people come near or part."""

import numpy as np
import pytest

from pacmo_core.synthesis import ACTIONS, sample_script
from pacmo_core.synthesis.body import sample_pair, sample_private_variables
from pacmo_core.synthesis.capture import PLANS, noiseless_motion
from pacmo_core.synthesis.choreography import RoleView
from tests.synthesis.clips import POPULATION, Clip, clips, distance_to_segment


def _palms(clip: Clip, time: float) -> float:
    palms = [clip.at(person, f"{clip.hand(person)}_hand", time) for person in (0, 1)]
    return float(np.linalg.norm(palms[0] - palms[1]))


@pytest.mark.parametrize(
    ("action", "bound"), [("handshake", 0.03), ("high five", 0.03), ("hand over", 0.10)]
)
def test_hands_meet(action: str, bound: float) -> None:
    for clip in clips(action):
        script = clip.script
        for time in (script.event, script.event + 0.5 * script.hold):
            assert _palms(clip, time) < bound, script


def test_two_who_talk_never_touch_and_a_pointing_hand_is_nearest_to_the_other() -> None:
    pointed = 0
    for clip in clips("point"):
        me, script = clip.initiator, clip.script
        apart = clip.motions[0][:, :, None] - clip.motions[1][:, None]
        assert np.linalg.norm(apart, axis=-1).min() > 0.15, script
        hand = f"{clip.hand(me)}_hand"
        ahead = clip.at(1 - me, "spine_base", script.event) - clip.at(
            me, "spine_base", script.event
        )
        reach = clip.at(me, hand, script.event) - clip.at(me, "spine_shoulder", script.event)
        pointed += bool(reach @ ahead / np.linalg.norm(ahead) > 0.38)
    assert 1 <= pointed <= 8  # a third of twelve


@pytest.mark.parametrize("act", ["handshake", "high five", "hand over"])
def test_who_walks_off_looks_where_they_go(act: str) -> None:
    leaving = 0
    for number, clip in enumerate(clips(act)):
        subject, other = clip.script.people
        private = sample_private_variables(np.random.default_rng(number), subject)
        plan = PLANS[act](RoleView(clip.script, "a", subject, other, private))
        # Long after: the last move has ended, whose way is that from the contact.
        held, after = plan.path(np.array([clip.script.event, 30.0]))
        way = np.arctan2(after[0] - held[0], after[1] - held[1])
        if private.leaves:
            leaving += 1
            assert np.cos(after[2] - way) > 0.999, clip.script
    assert leaving


def test_dancers_hold_both_hands_all_the_way_round() -> None:
    for clip in clips("circle dance"):
        for time in np.linspace(clip.script.event, clip.script.event + clip.script.hold, 7):
            for one, other in (("left_hand", "right_hand"), ("right_hand", "left_hand")):
                gap = clip.at(0, one, time) - clip.at(1, other, time)
                assert np.linalg.norm(gap) < 0.035, clip.script


def test_a_hug_lays_every_hand_on_the_partners_back() -> None:
    for clip in clips("hug"):
        time = clip.script.event + 0.6 * clip.script.hold
        for me, you in ((0, 1), (1, 0)):
            base, top = clip.at(you, "spine_base", time), clip.at(you, "spine_shoulder", time)
            for hand in ("left_hand", "right_hand"):
                palm = clip.at(me, hand, time)
                assert distance_to_segment(palm, base, top) < 0.20, clip.script
                behind = palm - base
                assert behind[2] * (1 if you == 1 else -1) > 0, clip.script


def test_a_punch_lands_on_the_face() -> None:
    for clip in clips("punch"):
        me = clip.initiator
        fist = clip.at(me, f"{clip.hand(me)}_hand", clip.script.event)
        head = clip.at(1 - me, "head", clip.script.event)
        assert 0.08 < np.linalg.norm(fist - head) < 0.19, clip.script


def test_a_push_lands_on_the_chest_with_both_hands() -> None:
    for clip in clips("push"):
        me, time = clip.initiator, clip.script.event
        shoulders = [clip.at(1 - me, f"{side}_shoulder", time) for side in ("left", "right")]
        for side in ("left", "right"):
            palm = clip.at(me, f"{side}_hand", time)
            assert distance_to_segment(palm, *shoulders) < 0.24, clip.script


def test_a_kick_lands_between_knee_and_chest() -> None:
    for clip in clips("kick"):
        me, time = clip.initiator, clip.script.event
        foot = clip.at(me, f"{clip.hand(me)}_foot", time)
        spine = [clip.at(1 - me, joint, time) for joint in ("spine_base", "spine_mid")]
        assert distance_to_segment(foot, *spine) < 0.30, clip.script
        assert foot[1] > clip.at(1 - me, "left_knee", time)[1] + 0.05, clip.script


@pytest.mark.parametrize("action", ["push", "punch", "kick"])
def test_who_is_struck_moves_only_after_the_blow(action: str) -> None:
    for clip in clips(action):
        other, event = 1 - clip.initiator, clip.script.event
        head = np.array([clip.at(other, "head", t) for t in (event - 0.1, event, event + 0.6)])
        assert np.linalg.norm(head[2] - head[1]) > 1.5 * np.linalg.norm(head[1] - head[0])


@pytest.mark.parametrize(("action", "sign"), [("approach", -1), ("depart", 1)])
def test_people_come_near_or_part(action: str, sign: int) -> None:
    for clip in clips(action):
        a, b = (motion[[0, -1], 0] for motion in clip.motions)
        first, last = np.linalg.norm(a - b, axis=-1)
        assert sign * (last - first) > 1.0, clip.script


def test_who_departs_turns_away() -> None:
    for clip in clips("depart"):
        for person, motion in enumerate(clip.motions):
            across = motion[-1, 12] - motion[-1, 16]
            ahead = np.cross(across, [0.0, 1.0, 0.0])[2] * (1 if person == 0 else -1)
            assert ahead < 0, clip.script


def test_the_most_unlike_pair_can_do_every_act() -> None:
    def unlike(pair: int) -> float:
        a, b = sample_pair(POPULATION, pair)
        return a.body.stature - b.body.stature

    for pair in (min(range(1, 900), key=unlike), max(range(1, 900), key=unlike)):
        assert abs(unlike(pair)) > 0.3
        for action in ACTIONS:
            for replication in range(1, 4):
                random = np.random.default_rng([pair, replication])
                script = sample_script(
                    random, population=POPULATION, pair=pair, action=action, replication=replication
                )
                motions = (
                    noiseless_motion(script, random, "a"),
                    noiseless_motion(script, random, "b"),
                )
                clip = Clip(script, motions)
                assert np.isfinite(motions[0]).all()
                assert np.isfinite(motions[1]).all()
                if action in ("handshake", "high five"):
                    assert _palms(clip, script.event) < 0.03, script
