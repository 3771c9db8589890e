"""Actions of force (push, kick, punch) and the reactions to them."""

import numpy as np

from pacmo_core.synthesis.choreography import (
    HandTarget,
    KickMotion,
    MotionPlan,
    RoleView,
    RootMove,
    TimeInterval,
    Trajectory,
    TrunkMotion,
    constant,
    free_hand,
    step_back_or_leave,
    way_in,
)
from pacmo_core.synthesis.gait import Path
from pacmo_core.synthesis.kinematics import Array, ramp
from pacmo_core.synthesis.script import CHEST_DEPTH


def push(role_view: RoleView) -> MotionPlan:
    """Push the partner's chest with both hands, or be pushed."""
    return _push_plan(role_view) if role_view.first else react_to_push(role_view)


def kick(role_view: RoleView) -> MotionPlan:
    """Kick the partner's thigh or belly, or be kicked."""
    return _kick_plan(role_view) if role_view.first else react_to_kick(role_view)


def punch(role_view: RoleView) -> MotionPlan:
    """Strike at the partner's face, or be struck."""
    return _punch_plan(role_view) if role_view.first else react_to_punch(role_view)


def _step_in(role_view: RoleView, distance: float) -> Path:
    """Walk in with a last step into the strike, and perhaps step back from it."""
    back = step_back_or_leave(role_view, role_view.event + 0.3)
    return way_in(role_view, role_view.event + 0.02, *back, extra=distance)


def _push_plan(role_view: RoleView) -> MotionPlan:
    private = role_view.private
    ready, back = (
        role_view.event - 0.5 - private.early,
        role_view.contact_end + 0.1 + 0.2 * private.more[4],
    )
    hand_targets = []
    for hand, sign in ((0, 1.0), (1, -1.0)):
        chamber = constant(sign * 0.15, -0.13, 0.17 - 0.03 * private.strength)
        hand_targets.append(
            HandTarget(
                hand,
                TimeInterval(ready - 0.2, ready + 0.15, role_view.event - 0.02, back),
                chamber,
                True,
                0.4,
            )
        )
        position = (
            role_view.aside + sign * 0.11,
            role_view.script.level,
            role_view.partner - CHEST_DEPTH - 0.03,
        )
        thrust = TimeInterval(role_view.event - 0.28, role_view.event, back, back + 0.5)
        hand_targets.append(
            HandTarget(hand, thrust, _follow_through(role_view, position), False, 0.35)
        )
    trunk_motion = TrunkMotion(
        TimeInterval(role_view.event - 0.25, role_view.event + 0.12, back, back + 0.6),
        pitch=0.16,
        ahead=0.05,
    )
    distance = 0.12 + 0.12 * private.more[5]
    path = _step_in(role_view, distance)
    return MotionPlan(
        path, step_rate_factor=1.2, hand_targets=tuple(hand_targets), trunk_motions=(trunk_motion,)
    )


def _follow_through(role_view: RoleView, point: tuple[float, float, float]) -> Trajectory:
    """Reach a point at the event and move a little beyond it."""

    def trajectory(times: Array) -> Array:
        on = ramp(times, role_view.event - 0.05, role_view.event + 0.2)
        position: Array = np.array(point) + np.outer(on, [0.0, 0.0, 0.07 * role_view.script.vigour])
        return position

    return trajectory


def _kick_plan(role_view: RoleView) -> MotionPlan:
    private, body, foot = role_view.private, role_view.subject.body, role_view.hand
    sign = 1.0 - 2.0 * foot
    event, gone = role_view.event, role_view.contact_end
    point = (
        role_view.aside + 0.05 * sign,
        role_view.script.level,
        role_view.partner - CHEST_DEPTH - 0.10,
    )
    leg = KickMotion(
        foot,
        point,
        TimeInterval(event - 0.52, event - 0.16, gone + 0.15, gone + 0.6),
        TimeInterval(event - 0.26, event, gone, gone + 0.34),
    )
    trunk_motion = TrunkMotion(
        TimeInterval(event - 0.5, event - 0.05, gone + 0.1, gone + 0.6),
        pitch=-0.16 - 0.08 * private.strength,
        twist=0.25 * sign,
        aside=-sign * 0.075,
        ahead=0.06,
        roll=0.05 * sign,
    )
    arms = TimeInterval(event - 0.45, event - 0.05, gone + 0.1, gone + 0.7)
    size = body.stature
    guard = (
        constant(-sign * 0.13, -0.10, 0.24),
        constant(-sign * 0.24 * size, -0.10 * size, 0.06),
    )[private.manner > 0]
    counter = constant(sign * 0.20 * size, -0.17 * size, 0.02)
    hand_targets = (
        HandTarget(1 - foot, arms, guard, True, 0.5),
        HandTarget(foot, arms, counter, True, 0.7),
    )
    path = way_in(role_view, event - 0.45, *step_back_or_leave(role_view, gone + 0.45))
    return MotionPlan(path, hand_targets=hand_targets, trunk_motions=(trunk_motion,), kick=leg)


def _punch_plan(role_view: RoleView) -> MotionPlan:
    private, hand = role_view.private, role_view.hand
    sign, event = 1.0 - 2.0 * role_view.hand, role_view.event
    ready = event - 0.55 - private.early
    back = role_view.contact_end + 0.04
    cocked = constant(sign * 0.21, -0.20, 0.16 - 0.04 * private.strength)
    position = constant(role_view.aside, role_view.script.level, role_view.partner - 0.17)
    hand_targets = (
        HandTarget(hand, TimeInterval(ready, ready + 0.35, event - 0.02, back), cocked, True, 0.6),
        HandTarget(
            hand, TimeInterval(event - 0.22, event, back, back + 0.45), position, False, 0.55
        ),
        HandTarget(
            1 - hand,
            TimeInterval(ready, ready + 0.4, event + 0.3, event + 0.9),
            constant(-sign * 0.13, -0.06, 0.24),
            True,
        ),
    )
    trunk_motions = (
        TrunkMotion(
            TimeInterval(ready, ready + 0.35, ready + 0.36, event),
            twist=0.35 * sign * private.strength,
        ),
        TrunkMotion(
            TimeInterval(event - 0.25, event, back, back + 0.6),
            twist=-0.5 * sign,
            pitch=0.12,
            ahead=0.06,
        ),
    )
    distance = 0.10 + 0.15 * private.more[5]
    path = _step_in(role_view, distance)
    return MotionPlan(
        path, step_rate_factor=1.2, hand_targets=hand_targets, trunk_motions=trunk_motions
    )


def react_to_push(role_view: RoleView) -> MotionPlan:
    """Stumble back from a push: straight, round to one side, or braced against it."""
    private, begin = role_view.private, role_view.response
    force = float(np.clip(role_view.script.vigour * private.strength, 0.45, 1.9))
    distance = (0.42, 0.36, 0.12)[private.manner] * force
    yaw = (0.0, 0.7 * private.side, 0.0)[private.manner]
    aside = (0.0, 0.12 * private.side, 0.0)[private.manner]
    fall = RootMove(begin - 0.02, begin + 0.55 + 0.35 * distance, aside, -distance, yaw, ease=0.3)
    jolt = TimeInterval(begin, begin + 0.18, begin + 0.28, begin + 0.85)
    trunk_motion = TrunkMotion(
        jolt, pitch=-0.20 * force, nod=0.15 * force, crouch=0.03 if private.manner < 2 else 0.08
    )
    twist = TrunkMotion(jolt, twist=(0.0, 0.35 * private.side, 0.0)[private.manner])
    arrive = role_view.event - 0.35 - private.early
    path = way_in(role_view, arrive, fall)
    fling = TimeInterval(begin + 0.04, begin + 0.32, begin + 0.4, begin + 1.0)
    high = -0.12 - 0.1 * private.more[5]
    hand_targets = tuple(
        HandTarget(
            hand, fling, constant(sign * 0.42, high, 0.14), True, 0.6, (sign * 0.12, 0.0, -0.05)
        )
        for hand, sign in ((0, 1.0), (1, -1.0))
        if private.more[6] < 0.75 or hand == int(private.side < 0)
    )
    return MotionPlan(
        path, step_rate_factor=1.45, hand_targets=hand_targets, trunk_motions=(trunk_motion, twist)
    )


def react_to_kick(role_view: RoleView) -> MotionPlan:
    """Take a kick: fold over it, jump aside, or fend it off with a hand."""
    private, begin = role_view.private, role_view.response
    force = float(np.clip(role_view.script.vigour * private.strength, 0.45, 1.8))
    distance = (0.34, 0.16, 0.26)[private.manner] * force
    aside = (0.0, 0.30 * private.side, 0.05 * private.side)[private.manner]
    flinch = RootMove(
        begin,
        begin + 0.6 + 0.3 * distance,
        aside,
        -distance,
        -0.3 * np.sign(aside) * abs(aside),
        ease=0.3,
    )
    interval = TimeInterval(begin, begin + 0.25, begin + 0.45, begin + 1.05)
    trunk_motion = (
        TrunkMotion(interval, pitch=0.30 * force, nod=0.15, crouch=0.05, ahead=-0.10 * force),
        TrunkMotion(interval, roll=-0.18 * private.side, twist=0.45 * private.side, crouch=0.03),
        TrunkMotion(interval, pitch=0.20 * force, twist=-0.35 * private.side, ahead=-0.06),
    )[private.manner]
    arrive = role_view.event - 0.35 - private.early
    belly = (constant(0.07, -0.36, 0.18), constant(-0.07, -0.33, 0.18))
    fend = constant(private.side * 0.12, -0.42, 0.30)
    near = int(private.side < 0)
    hand_targets = (
        tuple(HandTarget(hand, interval, belly[hand], True, 0.5) for hand in (0, 1)),
        tuple(
            HandTarget(hand, interval, constant(s * 0.30, -0.2, 0.2), True, 0.8)
            for hand, s in ((0, 1.0), (1, -1.0))
        ),
        (HandTarget(near, interval, fend, True, 0.4),),
    )[private.manner]
    return MotionPlan(
        way_in(role_view, arrive, flinch),
        step_rate_factor=1.4,
        hand_targets=hand_targets,
        trunk_motions=(trunk_motion,),
    )


def react_to_punch(role_view: RoleView) -> MotionPlan:
    """Take a blow at the face: recoil, reel to one side, or cover the face with both hands."""
    private, begin = role_view.private, role_view.response
    force = float(np.clip(role_view.script.vigour * private.strength, 0.45, 1.8))
    distance = (0.26, 0.14, 0.18)[private.manner] * force
    aside = (0.0, 0.14 * private.side, 0.0)[private.manner]
    stagger = RootMove(
        begin + 0.03, begin + 0.6 + 0.3 * distance, aside, -distance, 0.6 * aside, ease=0.3
    )
    jolt = TimeInterval(begin, begin + 0.17, begin + 0.3, begin + 0.9)
    trunk_motion = (
        TrunkMotion(jolt, pitch=-0.20 * force, nod=-0.22),
        TrunkMotion(
            jolt, pitch=-0.05, roll=-0.20 * private.side * force, twist=0.50 * private.side, nod=0.1
        ),
        TrunkMotion(jolt, pitch=-0.12 * force, crouch=0.06, nod=0.2),
    )[private.manner]
    arrive = role_view.event - 0.35 - private.early
    near = int(private.side < 0)
    cover = TimeInterval(begin + 0.05, begin + 0.35, begin + 0.75, begin + 1.3)
    ahead = (0.0, 0.0, 0.18)
    touch = (HandTarget(near, cover, constant(private.side * 0.07, 0.10, 0.20), True, 0.4, ahead),)
    both = tuple(
        HandTarget(hand, cover, constant(s * 0.09, 0.08, 0.24), True, 0.35, ahead)
        for hand, s in ((0, 1.0), (1, -1.0))
    )
    hand_targets = (touch if private.more[4] < 0.6 else (), touch, both)[private.manner]
    if private.manner == 0:
        hand_targets = (*hand_targets, *free_hand(role_view, 1 - near))
    path = way_in(role_view, arrive, stagger)
    return MotionPlan(
        path, step_rate_factor=1.4, hand_targets=hand_targets, trunk_motions=(trunk_motion,)
    )
