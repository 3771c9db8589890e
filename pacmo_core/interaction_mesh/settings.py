"""The numbers of InteractionMesh, without defaults: they are choices, and stand in parameters."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Weights:
    """What each term of the energy weighs; the Laplacian weighs 1.

    Parameters
    ----------
    power : of the distance in the Laplacian's weights, ``1 / (distance + softening) ** power``
    softening : metres added to distances, so that joints that touch do not silence all others
    shape : on each joint of a trunk that leaves its place beside the others
    acceleration : of the change, at 30 frames a second
    contact : of all that a joint touches, together
    contact_reach : metres at which contact has fallen to 1/e
    stance : on steps of the change where a joint stands on the ground, at 30 frames a second
    height : on vertical change there
    anchor : on change as such, which settles where the scene as a whole stands
    """

    power: float
    softening: float
    shape: float
    acceleration: float
    contact: float
    contact_reach: float
    stance: float
    height: float
    anchor: float


@dataclass(frozen=True, kw_only=True)
class Support:
    """When a joint stands on the ground.

    Parameters
    ----------
    reach : metres above the ground that the joint comes down to at its lowest
    height : metres above its own lowest level
    speed : metres a second
    fade : seconds in which it sets in and lets go; a hold that starts at once jerks the motion
    """

    reach: float
    height: float
    speed: float
    fade: float


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One try of the solver.

    Parameters
    ----------
    penalty : on the distance between bones and their target lengths, as a share of the force with
        which the energy itself holds them. Small ones settle in few iterations, unless bones are
        pressed together so hard that they buckle and never settle; large ones always do, slowly
    iterations : of the alternating directions, at most
    apart : penalty that keeps the bodies apart; 0 leaves that out
    step : a body has settled once an iteration moves bones by no more than this share of how much
        they grow, root mean square, where one bone grows, and less where more do
        (``ladder.asked_of``); one that has not goes on to the next rung
    """

    penalty: float
    iterations: int
    apart: float
    step: float


@dataclass(frozen=True, kw_only=True)
class AttemptLimits:
    """When a try is good enough to stay.

    Parameters
    ----------
    residual : raw residual, a share of the bone's length
    penetration : metres deeper than the source
    seam : ratio, see the report
    """

    residual: float
    penetration: float
    seam: float


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Everything the solver is told.

    Parameters
    ----------
    graph : ``complete``, every joint of one body to every one of the other; or ``delaunay``,
        the tetrahedra of each frame
    weights, support, limits : see there
    rungs : tries, in order, until one is within the limits
    relaxation : over-relaxation of the alternating directions, 1 to 2
    clearance : metres between joints of the two bodies under which they penetrate
    guarded : pairs of joints a frame, the closest ones, that rungs with ``apart`` keep apart
    near : metres; a pair of joints nearer than this in the source counts as near in the report
    touching : metres; nearer than this as in contact
    slack : metres by which a contact may part and still count as kept
    """

    graph: str
    weights: Weights
    support: Support
    limits: AttemptLimits
    rungs: tuple[Attempt, ...]
    relaxation: float
    clearance: float
    guarded: int
    near: float
    touching: float
    slack: float

    def __post_init__(self) -> None:
        if self.graph not in ("complete", "delaunay"):
            raise ValueError(f"graph must be complete or delaunay; got {self.graph!r}")
        if not self.rungs:
            raise ValueError("rungs must not be empty")
        if not 0 < self.relaxation < 2:
            raise ValueError(f"relaxation must be between 0 and 2; got {self.relaxation}")
