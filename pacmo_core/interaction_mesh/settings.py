"""Settings of InteractionMesh: energy weights, ground support, ADMM attempts, limits.

None has a default: they are choices and are set in ``params.yaml``, section ``augment.solver``.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of the energy's terms (``energy``); the Laplacian term has weight 1.

    Parameters
    ----------
    distance_exponent : p in the Laplacian weights ``1 / (distance + distance_softening) ** p``
    distance_softening : metres added to every distance; bounds the weight of touching joints
    trunk_shape : weight on the deformation of each trunk
    acceleration : weight on the acceleration of the displacement, at 30 frames per second
    contact : weight of all contacts of one joint together
    contact_range : metres at which a contact weight has fallen to 1/e
    stance : weight on the velocity of the displacement of supporting joints, at 30 frames per
        second
    stance_height : weight on the vertical displacement of supporting joints
    regularisation : Tikhonov weight on the displacement; fixes the position of the whole scene
    """

    distance_exponent: float
    distance_softening: float
    trunk_shape: float
    acceleration: float
    contact: float
    contact_range: float
    stance: float
    stance_height: float
    regularisation: float


@dataclass(frozen=True, kw_only=True)
class Support:
    """Criteria by which a joint supports the body on the ground.

    Parameters
    ----------
    max_height : metres above the ground; a joint whose lowest level is higher never supports
    height_tolerance : metres above the joint's own lowest level
    max_speed : metres per second
    fade_time : seconds over which the support weight rises and falls; a step in the weight would
        cause a jerk in the motion
    """

    max_height: float
    height_tolerance: float
    max_speed: float
    fade_time: float


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """Settings of one attempt of the ADMM solver.

    Parameters
    ----------
    bone_penalty : ADMM penalty of the bone length constraints, relative to the stiffness with
        which the energy holds each bone. Small penalties converge in few iterations, unless the
        compression of bones is so high that they buckle and ADMM cycles; large penalties always
        converge, slowly
    max_iterations : of ADMM
    separation_penalty : ADMM penalty of the separation of close pairs of joints of the two bodies;
        0 leaves these constraints out
    tolerance : on the fixed-point residual (``Report.fixed_point_residual``); a body that has not
        converged goes on to the next attempt
    """

    bone_penalty: float
    max_iterations: int
    separation_penalty: float
    tolerance: float


@dataclass(frozen=True, kw_only=True)
class AttemptLimits:
    """Limits within which the result of an attempt is accepted; see ``Report``.

    Parameters
    ----------
    primal_residual : fraction of a bone's length
    penetration : metres, in addition to the source's
    acceleration_peak_ratio : dimensionless
    """

    primal_residual: float
    penetration: float
    acceleration_peak_ratio: float


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of InteractionMesh.

    Parameters
    ----------
    graph : ``complete``, every joint of one body is connected to every joint of the other; or
        ``delaunay``, the edges of each frame's Delaunay tetrahedra
    weights : of the energy
    support : criteria of ground support
    limits : within which an attempt is accepted
    attempts : in order, until one is within the limits
    relaxation : ADMM over-relaxation factor, 1 to 2
    clearance : metres between joints of the two bodies below which they penetrate
    n_separation_pairs : closest pairs of joints in each frame that attempts with a
        ``separation_penalty`` keep apart
    near_distance : metres; a pair of joints closer than this in the source counts as near in the
        report
    contact_distance : metres; a pair of joints closer than this in the source is in contact
    contact_slack : metres by which the distance of a preserved contact may grow

    Raises
    ------
    ValueError
        If the graph is unknown, there is no attempt, or the relaxation is not between 0 and 2.
    """

    graph: str
    weights: Weights
    support: Support
    limits: AttemptLimits
    attempts: tuple[Attempt, ...]
    relaxation: float
    clearance: float
    n_separation_pairs: int
    near_distance: float
    contact_distance: float
    contact_slack: float

    def __post_init__(self) -> None:
        if self.graph not in ("complete", "delaunay"):
            raise ValueError(f"graph must be complete or delaunay; got {self.graph!r}")
        if not self.attempts:
            raise ValueError("attempts must not be empty")
        if not 0 < self.relaxation < 2:
            raise ValueError(f"relaxation must be between 0 and 2; got {self.relaxation}")
