"""Actions of lasting contact: the hug and the circle dance."""

import numpy as np

from pacmo_core.synthesis.choreography import (
    HandTarget,
    MotionPlan,
    RoleView,
    TimeInterval,
    Trajectory,
    TrunkMotion,
    oscillating,
    step_back_or_leave,
    way_in,
)
from pacmo_core.synthesis.gait import Path
from pacmo_core.synthesis.kinematics import Array, ease_in_out, window

PALM_TO_SPINE = 0.10  # metres from the partner's spine to a palm on the back


def hug(role_view: RoleView) -> MotionPlan:
    """Put both arms round each other; heads go past on one side. Some pat, some rock."""
    private = role_view.private
    over = role_view.hand
    side = 1.0 if over == 1 else -1.0  # the head goes away from the arm that is above
    start = role_view.event - 0.6 - (private.early if role_view.first else -0.5 * private.delay)
    gone = role_view.contact_end + 0.12 * private.more[4]
    hand_targets = []
    for hand in (0, 1):
        sign = 1.0 - 2.0 * hand
        interval = TimeInterval(start, role_view.event + 0.1, gone, gone + 0.6)
        out = (sign * 0.34, 0.0, 0.0)
        hand_targets.append(
            HandTarget(
                hand, interval, _palm_on_back(role_view, hand, hand == over), False, 0.85, out
            )
        )
    trunk_motions = [
        TrunkMotion(
            TimeInterval(start + 0.1, role_view.event, gone, gone + 0.5),
            pitch=0.12,
            roll=-0.10 * side,
            nod=0.1,
        )
    ]
    if private.manner == 1:
        middle = 0.5 * (role_view.event + role_view.contact_end)
        rock = TimeInterval(role_view.event, middle, middle + 0.05, role_view.contact_end + 0.1)
        trunk_motions.append(TrunkMotion(rock, roll=0.05 * private.side * private.strength))
    path = way_in(
        role_view,
        role_view.event + 0.05,
        *step_back_or_leave(role_view, gone - 0.1, always=True),
        extra=0.3,
    )
    return MotionPlan(path, hand_targets=tuple(hand_targets), trunk_motions=tuple(trunk_motions))


def _palm_on_back(role_view: RoleView, hand: int, above: bool) -> Trajectory:
    """Lay a palm on the partner's back; in the first manner it pats."""
    sign = 1.0 - 2.0 * hand
    middle = -role_view.place  # where the partner's spine is along my x
    low = -0.02 if above else 0.30
    spot = (
        middle + 0.10 * sign,
        role_view.other.body.shoulder_height - low,
        role_view.partner + PALM_TO_SPINE,
    )
    pats = above and role_view.private.manner == 0

    def trajectory(times: Array) -> Array:
        patting = window(
            times,
            role_view.event + 0.1,
            role_view.event + 0.3,
            role_view.contact_end - 0.2,
            role_view.contact_end,
        )
        lift = 0.5 - 0.5 * np.cos(2.0 * np.pi * 2.6 * (times - role_view.event - 0.1))
        position: Array = np.array(spot) + np.outer(patting * lift, [0.0, 0.0, 0.035 * pats])
        return position

    return trajectory


def circle_dance(role_view: RoleView) -> MotionPlan:
    """Join both hands and go round each other."""
    private, script = role_view.private, role_view.script
    contact_start = role_view.event - 0.1

    def angle(times: Array) -> Array:
        return script.turn * ease_in_out(times, role_view.event, role_view.contact_end, 0.5)

    def round_about(trajectory: Trajectory) -> Trajectory:
        def turned(times: Array) -> Array:
            x, y, z = trajectory(times).T
            c, s = np.cos(angle(times)), np.sin(angle(times))
            return np.stack([c * x + s * z, y, c * z - s * x], axis=-1)

        return turned

    def path(times: Array) -> Array:
        x, z, yaw = approach(times).T
        c, s = np.cos(angle(times)), np.sin(angle(times))
        return np.stack([c * x + s * z, c * z - s * x, yaw + angle(times)], axis=-1)

    approach: Path = way_in(role_view, role_view.event - 0.1 - private.early)
    gone = role_view.contact_end + 0.15 * private.more[4]
    start = contact_start - 0.6 + 0.4 * private.delay
    hand_targets = tuple(
        HandTarget(
            hand,
            TimeInterval(start, contact_start, gone, gone + 0.5),
            round_about(oscillating(role_view, (sign * 0.2, script.level, -0.01))),
            flare=0.4 + 0.3 * private.more[5],
        )
        for hand, sign in ((0, 1.0), (1, -1.0))
    )
    rock = tuple(
        TrunkMotion(
            TimeInterval(t, t + 0.35, t + 0.36, t + 0.7),
            roll=0.07 * private.strength * side,
            crouch=0.02 * private.strength,
        )
        for t, side in zip(
            np.arange(role_view.event, role_view.contact_end - 0.3, 0.7),
            (1.0, -1.0) * 4,
            strict=False,
        )
    )
    return MotionPlan(
        path,
        step_rate_factor=1.15 + 0.2 * private.more[6],
        hand_targets=hand_targets,
        trunk_motions=rock,
    )
