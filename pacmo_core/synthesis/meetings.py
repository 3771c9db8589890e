"""Actions of meeting: approach, depart, point, handshake, high five, hand over."""

import numpy as np

from pacmo_core.synthesis.choreography import (
    HandTarget,
    MotionPlan,
    RoleView,
    RootMove,
    TimeInterval,
    Trajectory,
    TrunkMotion,
    constant,
    contact_point,
    free_hand,
    oscillating,
    root_path,
    step_back_or_leave,
    way_in,
)
from pacmo_core.synthesis.kinematics import Array


def approach(role_view: RoleView) -> MotionPlan:
    """Walk toward each other; some wave or nod."""
    arrive = role_view.event - 0.25 + 0.5 * role_view.private.delay
    trunk_motions: tuple[TrunkMotion, ...] = ()
    hand = int(role_view.private.side < 0)
    hand_targets = free_hand(role_view, hand) if role_view.private.idle == 3 else ()
    if role_view.private.manner == 1:
        trunk_motions = (
            TrunkMotion(
                TimeInterval(arrive - 0.3, arrive + 0.05, arrive + 0.1, arrive + 0.6), nod=0.3
            ),
        )
    if role_view.private.manner == 2:
        hand_targets = (_wave(role_view, hand, arrive - 0.6),)
    return MotionPlan(
        way_in(role_view, arrive),
        hand_targets=hand_targets,
        trunk_motions=trunk_motions,
    )


def depart(role_view: RoleView) -> MotionPlan:
    """Turn away over the left or the right and walk off; some wave, some step back first."""
    private = role_view.private
    begin = role_view.event + private.delay + (0.35 if private.manner == 1 else 0.0)
    stray = 0.4 * role_view.script.turn + 0.2 * (private.more[1] - 0.5)
    backward = 0.25 if private.manner == 2 else 0.0
    distance = role_view.entry - backward
    pace = 1.05 * role_view.subject.tempo * (0.9 + 0.25 * private.more[0])
    go = RootMove(
        begin + 0.35,
        begin + 0.95 + distance / pace,
        -distance * np.sin(stray),
        -distance * np.cos(stray),
    )
    yaw = private.side * np.pi + stray - private.facing
    turn = RootMove(begin, begin + 1.5, yaw=yaw, ease=0.4)
    back = RootMove(begin - 0.3, begin + 0.6, z=-backward)
    hand = int(private.side < 0)
    hand_targets = (
        (_wave(role_view, hand, 0.1),) if private.manner == 1 else free_hand(role_view, hand)
    )
    trunk_motion = TrunkMotion(
        TimeInterval(begin - 0.1, begin + 0.25, begin + 0.45, begin + 0.95),
        twist=0.3 * private.side,
    )
    return MotionPlan(
        root_path((role_view.place, -role_view.stand, private.facing), back, turn, go),
        step_rate_factor=1.25,
        hand_targets=hand_targets,
        trunk_motions=(trunk_motion,),
    )


def _wave(role_view: RoleView, hand: int, start: float) -> HandTarget:
    sign, size = 1.0 - 2.0 * hand, role_view.subject.body.stature

    def trajectory(times: Array) -> Array:
        x = sign * (0.16 * size + 0.05 * np.sin(2.0 * np.pi * 2.2 * (times - start)))
        return np.stack([x, np.full_like(x, 0.12 * size), np.full_like(x, 0.10 * size)], axis=-1)

    return HandTarget(
        hand,
        TimeInterval(start, start + 0.45, start + 0.85, start + 1.35),
        trajectory,
        True,
        0.5,
        (sign * 0.12, 0.0, 0.2),
    )


def point(role_view: RoleView) -> MotionPlan:
    """Talk and listen at a distance: hands beat time, one points at the other, the other nods."""
    private = role_view.private
    arrive = role_view.event - 0.4 - private.early
    begin = role_view.event if role_view.first else role_view.contact_end - private.delay
    end = begin + (role_view.script.hold if role_view.first else 0.9)
    interval = TimeInterval(begin - 0.4, begin, end, end + 0.5)
    nod = TimeInterval(
        role_view.response, role_view.response + 0.2, role_view.response + 0.3, role_view.event + 1
    )
    trunk_motions = [TrunkMotion(nod, nod=0.25 * private.strength)]
    hand_targets = free_hand(role_view, 1 - role_view.hand)
    if private.manner == 0:
        both = private.more[4] < 0.5
        hand_targets = tuple(
            HandTarget(hand, interval, _beats(role_view, hand), True, 0.3)
            for hand in (0, 1)
            if both or hand == role_view.hand
        )
        trunk_motions.append(TrunkMotion(interval, pitch=0.05 * private.strength))
    if private.manner == 1 and role_view.first:
        hand_targets = (_point_at(role_view, interval), *hand_targets)
        trunk_motions.append(TrunkMotion(interval, pitch=0.06 * private.strength))
    path = way_in(role_view, arrive, *step_back_or_leave(role_view, end + 0.3))
    return MotionPlan(path, hand_targets=hand_targets, trunk_motions=tuple(trunk_motions))


def _beats(role_view: RoleView, hand: int) -> Trajectory:
    """Beat the time of what is said, before the chest."""
    sign, size = 1.0 - 2.0 * hand, role_view.subject.body.stature
    private = role_view.private

    def trajectory(times: Array) -> Array:
        wave = np.sin(np.pi * role_view.script.beat * (times - role_view.event) + hand)
        rise = 0.03 * private.strength * wave
        x = sign * (0.11 * size + 0.4 * rise)
        depth = np.full_like(x, (0.11 + 0.05 * private.more[5]) * size)
        return np.stack([x, rise - (0.13 + 0.06 * private.more[6]) * size, depth], axis=-1)

    return trajectory


def _point_at(role_view: RoleView, interval: TimeInterval) -> HandTarget:
    """Stretch an arm towards the other's chest, which is out of reach."""
    body, sign = role_view.subject.body, 1.0 - 2.0 * role_view.hand
    reach = (0.75 + 0.15 * role_view.private.more[5]) * body.arm
    place = constant(
        role_view.place + 0.7 * sign * body.shoulder_half,
        min(role_view.script.level, body.shoulder_height),
        reach - role_view.stand,
    )
    return HandTarget(role_view.hand, interval, place, curve=(sign * 0.08, 0.0, 0.0))


def handshake(role_view: RoleView) -> MotionPlan:
    """Join right hands and shake them; some cover with the other hand, some bow."""
    private = role_view.private
    start = role_view.event - 0.5 - (private.early if role_view.first else -0.4 * private.delay)
    gone = role_view.contact_end + 0.1 * private.more[4]
    shake = HandTarget(
        role_view.hand,
        TimeInterval(start, role_view.event, gone, gone + 0.45 + 0.2 * private.more[5]),
        oscillating(role_view, contact_point(role_view, 0.008)),
    )
    twist = 0.12 * (2.0 * role_view.hand - 1.0)
    trunk_motions = [
        TrunkMotion(shake.interval, pitch=0.07 * private.strength, twist=twist, ahead=0.02)
    ]
    other = free_hand(role_view, 1 - role_view.hand)
    if private.manner == 1:
        cover = TimeInterval(
            role_view.event + 0.5 * private.delay,
            role_view.event + 0.45 + private.delay,
            gone - 0.02,
            gone + 0.5,
        )
        x, y, z = contact_point(role_view, 0.05)
        goal = oscillating(role_view, (x + 0.03 * (1.0 - 2.0 * (1 - role_view.hand)), y + 0.05, z))
        other = (HandTarget(1 - role_view.hand, cover, goal),)
        trunk_motions.append(TrunkMotion(cover, pitch=0.10, twist=-twist, ahead=0.03))
    if private.manner == 2:
        bow = TimeInterval(
            role_view.event - 0.2,
            role_view.event + 0.25,
            role_view.event + 0.3,
            role_view.event + 0.9,
        )
        trunk_motions.append(
            TrunkMotion(
                bow, pitch=0.12 * private.strength, nod=0.25, ahead=-0.07 * private.strength
            )
        )
    path = way_in(
        role_view,
        role_view.event - 0.1 - private.early,
        *step_back_or_leave(role_view, gone + 0.1, lead=True),
        lead=True,
    )
    return MotionPlan(path, hand_targets=(shake, *other), trunk_motions=tuple(trunk_motions))


def high_five(role_view: RoleView) -> MotionPlan:
    """Clap raised hands together; some swing wide, some hop into it."""
    private = role_view.private
    start = role_view.event - 0.55 - (private.early if role_view.first else -0.4 * private.delay)
    sign = 1.0 - 2.0 * role_view.hand
    clap = HandTarget(
        role_view.hand,
        TimeInterval(
            start,
            role_view.event,
            role_view.contact_end,
            role_view.contact_end + 0.5 + 0.25 * private.more[4],
        ),
        constant(*contact_point(role_view, 0.008)),
        flare=0.3 + 0.4 * private.more[5],
        curve=(sign * 0.12 * private.strength, 0.0, 0.12),
    )
    trunk_motions = [TrunkMotion(clap.interval, pitch=0.04, twist=-0.15 * sign, aside=0.0)]
    if private.manner == 1:
        dip = TimeInterval(start - 0.1, start + 0.2, start + 0.2, role_view.event + 0.05)
        trunk_motions.append(TrunkMotion(dip, crouch=0.06 * private.strength, twist=0.2 * sign))
    if private.manner == 2:
        after = TimeInterval(
            role_view.contact_end,
            role_view.contact_end + 0.3,
            role_view.contact_end + 0.4,
            role_view.contact_end + 0.9,
        )
        trunk_motions.append(
            TrunkMotion(after, twist=0.35 * sign, crouch=0.04 * private.strength, nod=0.15)
        )
    path = way_in(
        role_view,
        role_view.event - 0.1 - private.early,
        *step_back_or_leave(role_view, role_view.contact_end, lead=True),
        lead=True,
    )
    return MotionPlan(
        path,
        hand_targets=(clap, *free_hand(role_view, 1 - role_view.hand)),
        trunk_motions=tuple(trunk_motions),
    )


def hand_over(role_view: RoleView) -> MotionPlan:
    """Hand over an object of a hand's breadth; it is taken with one hand or two."""
    private, size = role_view.private, role_view.subject.body.stature
    sign = 1.0 - 2.0 * role_view.hand
    start = (
        role_view.event - 0.55 - (0.2 + private.early if role_view.first else -0.4 * private.delay)
    )
    gone = role_view.contact_end + 0.1 * private.more[4]
    give = HandTarget(
        role_view.hand,
        TimeInterval(start, role_view.event, gone, gone + 0.5),
        constant(*contact_point(role_view, 0.04)),
    )
    held = constant(sign * 0.08 * size, -0.20 * size, 0.16 * size)
    kept = (
        TimeInterval(-2.0, -1.5, start + 0.1, role_view.event)
        if role_view.first
        else TimeInterval(gone, gone + 0.5, 9.0, 9.9)
    )
    trunk_motions = [
        TrunkMotion(give.interval, pitch=0.06 * private.strength, twist=-0.12 * sign, ahead=0.02)
    ]
    hand_targets = (HandTarget(role_view.hand, kept, held, True), give)
    other = free_hand(role_view, 1 - role_view.hand)
    if private.manner == 1:
        x, y, z = contact_point(role_view, 0.05)
        late = TimeInterval(start + 0.1, role_view.event + 0.05, gone, gone + 0.55)
        other = (HandTarget(1 - role_view.hand, late, constant(x - 0.05 * sign, y - 0.03, z)),)
        trunk_motions.append(TrunkMotion(late, pitch=0.08, twist=0.12 * sign, ahead=0.02))
    if private.manner == 2:
        thanks = TimeInterval(gone, gone + 0.35, gone + 0.45, gone + 0.95)
        trunk_motions.append(TrunkMotion(thanks, pitch=0.12 * private.strength, nod=0.25))
    path = way_in(
        role_view,
        role_view.event - 0.1 - private.early,
        *step_back_or_leave(role_view, gone + 0.1, lead=True),
        lead=True,
    )
    return MotionPlan(
        path, hand_targets=(*hand_targets, *other), trunk_motions=tuple(trunk_motions)
    )
