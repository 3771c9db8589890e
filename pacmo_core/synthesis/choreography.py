"""Motion plans: root path, hand targets, trunk motions and kicks of one person in one action.

All positions are in the person's own frame: the two people's meeting plane is z = 0, this
person stands behind it at negative z and looks along +z; x is to the left, y is up.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pacmo_core.synthesis.body import PrivateVariables, Subject
from pacmo_core.synthesis.gait import Path
from pacmo_core.synthesis.kinematics import Array, bump, ease_in_out, window
from pacmo_core.synthesis.script import Role, Script

LEFT, RIGHT = 0, 1
MAX_LEAD = 0.6  # radians by which the side of a hand that is given goes ahead
Trajectory = Callable[[Array], Array]  # (T,) seconds to (T, 3) metres


@dataclass(frozen=True)
class TimeInterval:
    """A weight over time: seconds at which it starts to rise, is 1, starts to fall, and is 0."""

    start: float
    arrive: float
    leave: float
    back: float


@dataclass(frozen=True)
class HandTarget:
    """A hand's palm follows a trajectory in an interval; outside it the arm hangs or swings.

    Parameters
    ----------
    hand : LEFT or RIGHT
    interval : of the weight
    trajectory : positions over time, in the person's frame or, if ``relative_to_chest``,
        relative to the upper spine
    relative_to_chest : whether the trajectory is in the chest's frame
    flare : 0 elbow down and back, 1 elbow out to the side
    curve : metres by which the paths to the target and back are curved, (x, y, z)
    """

    hand: int
    interval: TimeInterval
    trajectory: Trajectory
    relative_to_chest: bool = False
    flare: float = 0.2
    curve: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TrunkMotion:
    """The trunk bends in an interval: radians and metres, signs as in ``kinematics``.

    Parameters
    ----------
    interval : of the weight
    pitch, roll, twist : of the trunk; twist turns the shoulders to the left
    nod : of the head beyond the trunk's pitch
    crouch, aside, ahead : pelvis displacement down, to the left, forward
    """

    interval: TimeInterval
    pitch: float = 0.0
    roll: float = 0.0
    twist: float = 0.0
    nod: float = 0.0
    crouch: float = 0.0
    aside: float = 0.0
    ahead: float = 0.0


@dataclass(frozen=True)
class KickMotion:
    """A foot is lifted, extended to a point in the air, drawn back and put down.

    Parameters
    ----------
    foot : LEFT or RIGHT
    point : the ankle's target
    chamber : interval in which the knee is up
    thrust : interval in which the leg is extended; within ``chamber``
    """

    foot: int
    point: tuple[float, float, float]
    chamber: TimeInterval
    thrust: TimeInterval


@dataclass(frozen=True)
class MotionPlan:
    """One person's motion plan of a clip.

    Parameters
    ----------
    path : of the pelvis
    step_rate_factor : factor on the person's usual step rate
    hand_targets : where two overlap, the later in the tuple applies
    trunk_motions : overlapping ones are added
    kick : a kick, if any
    """

    path: Path
    step_rate_factor: float = 1.0
    hand_targets: tuple[HandTarget, ...] = ()
    trunk_motions: tuple[TrunkMotion, ...] = ()
    kick: KickMotion | None = None


def constant(x: float, y: float, z: float) -> Trajectory:
    """Make a constant trajectory."""
    return lambda times: np.tile([x, y, z], (len(times), 1))


@dataclass(frozen=True)
class RoleView:
    """The script as one person performs it: subject, partner, private variables."""

    script: Script
    role: Role
    subject: Subject
    other: Subject
    private: PrivateVariables

    @property
    def first(self) -> bool:
        """Whether this person is the initiator."""
        return self.role == self.script.initiator

    @property
    def stand(self) -> float:
        """Metres from this person to the meeting plane."""
        return self.script.stand["ab".index(self.role)]

    @property
    def partner(self) -> float:
        """The partner's position along this person's z."""
        return self.script.stand[1 - "ab".index(self.role)]

    @property
    def place(self) -> float:
        """Metres to the left of the middle at which this person stands."""
        return 0.5 * self.script.passing

    @property
    def entry(self) -> float:
        """Metres that this person walks in or out."""
        return self.script.entry["ab".index(self.role)]

    @property
    def hand(self) -> int:
        """The hand that this person uses."""
        return self.script.hands["ab".index(self.role)]

    @property
    def aside(self) -> float:
        """The contact's x in this person's frame."""
        return self.script.aside * (1.0 if self.role == "a" else -1.0)

    def facing(self, *, lead: bool) -> float:
        """Radians to the left by which the pelvis is turned at the event.

        With ``lead`` the side of the used hand goes ahead.
        """
        ahead = MAX_LEAD * self.private.more[7] * (1.0 if self.hand == RIGHT else -1.0)
        return self.private.facing + ahead * lead

    @property
    def event(self) -> float:
        """Seconds of the main event."""
        return self.script.event

    @property
    def contact_end(self) -> float:
        """Seconds of the end of the contact."""
        return self.script.event + self.script.hold

    @property
    def response(self) -> float:
        """Seconds at which this person responds to a strike."""
        return self.script.event + 0.5 * self.private.delay


@dataclass(frozen=True)
class RootMove:
    """A translation of the pelvis along x and z and a rotation, between two times."""

    start: float
    stop: float
    x: float = 0.0
    z: float = 0.0
    yaw: float = 0.0
    ease: float = 0.45
    bow: float = 0.0


def root_path(start: tuple[float, float, float], *moves: RootMove) -> Path:
    """Start at x, z and a yaw, and make every move; ``bow`` curves it sideways."""

    def path(times: Array) -> Array:
        position = np.tile(start, (len(times), 1))
        for move in moves:
            fraction = ease_in_out(times, move.start, move.stop, move.ease)
            position = position + fraction[:, None] * [move.x, move.z, move.yaw]
            position[:, 0] += move.bow * bump(fraction)
        return position

    return path


def way_in(
    role_view: RoleView, arrive: float, *then: RootMove, extra: float = 0.0, lead: bool = False
) -> Path:
    """Come in obliquely, be turned to the other at ``arrive``, and make further moves.

    People who shake hands or hand something over turn the pelvis away from the hand that they give
    and pass the other's line: in SBU the other is 41 degrees to the right of the pelvis as hands
    join (a quarter of them under 27, a quarter over 46).

    Parameters
    ----------
    extra : metres in addition to the script's, for a last step
    lead : whether the side of the used hand goes ahead
    """
    private, distance = role_view.private, role_view.entry + extra
    time = 0.5 + distance / (role_view.subject.tempo * (0.9 + 0.25 * private.more[0]))
    heading = private.heading if distance else 0.6 * private.heading
    oblique = distance * float(np.tan(heading))
    bow = private.side * 0.05 * private.more[1]
    return root_path(
        (role_view.place - oblique, -role_view.stand - distance, heading),
        RootMove(arrive - time, arrive, x=oblique, z=distance, bow=bow),
        RootMove(arrive - max(0.8, 0.7 * time), arrive, yaw=role_view.facing(lead=lead) - heading),
        *then,
    )


def step_back_or_leave(
    role_view: RoleView, start: float, *, always: bool = False, lead: bool = False
) -> tuple[RootMove, ...]:
    """Step back after the action, or walk off; unless ``always``, only if the script has it.

    ``lead`` is that of ``way_in``: who walks off turns from where it left the pelvis.
    """
    private = role_view.private
    if always or not (role_view.script.stays or private.leaves):
        begin = start + 0.1 + private.delay
        distance = 0.2 + 0.35 * private.more[2]
        stop = begin + 0.55 + distance / 0.9
        return (RootMove(begin, stop, z=-distance, yaw=0.35 * private.side),)
    if not private.leaves:
        return ()
    way = private.side * (1.2 + 1.9 * private.more[2])  # radians; not through the other
    begin, distance = start - 0.1 + 0.5 * private.delay, 0.7 + 0.8 * private.more[1]
    x, z = distance * float(np.sin(way)), distance * float(np.cos(way))
    stop = begin + 0.8 + distance / (1.1 * role_view.subject.tempo)
    yaw = way - role_view.facing(lead=lead)
    turn = RootMove(begin, begin + 0.7 + 0.35 * abs(yaw), yaw=yaw, ease=0.4)
    return turn, RootMove(begin + 0.2, stop, x=x, z=z)


def free_hand(role_view: RoleView, hand: int) -> tuple[HandTarget, ...]:
    """Rest an unused hand: hanging, on the hip, behind the back or in front of the belly."""
    sign = 1.0 - 2.0 * hand
    size = role_view.subject.body.stature
    position = (
        None,
        (0.118 * size, -0.245 * size, -0.02, 0.95),
        (0.03 * size, -0.245 * size, -0.15, 0.55),
        (0.03 * size, -0.200 * size, 0.19, 0.25),
    )[role_view.private.idle]
    if position is None:
        return ()
    x, y, z, flare = position
    begin = role_view.event + 0.4 if role_view.private.more[3] < 0.25 else -2.0
    interval = TimeInterval(begin, begin + 0.6, 90.0, 91.0)
    bend = (sign * (0.16 if z < 0 else 0.06), 0.0, 0.0)
    return (HandTarget(hand, interval, constant(sign * x, y, z), True, flare, bend),)


def contact_point(role_view: RoleView, give: float = 0.0) -> tuple[float, float, float]:
    """Compute the contact point, ``give`` metres on this person's side of the meeting plane."""
    return role_view.aside, role_view.script.level, -give


def oscillating(role_view: RoleView, point: tuple[float, float, float]) -> Trajectory:
    """Oscillate about a point at the script's beat while the contact lasts."""

    def trajectory(times: Array) -> Array:
        still = window(
            times,
            role_view.event - 0.05,
            role_view.event + 0.2,
            role_view.contact_end - 0.15,
            role_view.contact_end + 0.1,
        )
        wave = np.sin(2.0 * np.pi * role_view.script.beat * (times - role_view.event)) * still
        position: Array = np.array(point) + np.outer(
            wave, [0.0, 0.03 * role_view.script.vigour, 0.0]
        )
        return position

    return trajectory
