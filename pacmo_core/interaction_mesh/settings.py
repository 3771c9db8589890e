"""Settings of InteractionMesh: energy weights, ground support, ADMM attempts, limits.

None has a default: they are choices and are set in ``params.yaml``, section ``augment.solver``.
"""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Posture:
    """Weights that keep the direction of each bone, by part of the body; see ``energy``.

    Parameters
    ----------
    trunk : bones between the limbs, with neck and head
    upper_limb : thighs and upper arms
    shin, foot : each, toes included in the foot
    forearm : forearms and hands
    knee, elbow : weights on the angle of the hinge
    spine : weight on the angle between two bones of the trunk
    """

    trunk: float
    upper_limb: float
    shin: float
    foot: float
    forearm: float
    knee: float
    elbow: float
    spine: float


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Weights of the energy's terms (``energy``); the Laplacian term has weight 1.

    Parameters
    ----------
    distance_softening : metres added to every distance, of which the Laplacian weights are the
        inverse; bounds the weight of touching joints
    interaction_range : metres at which a Laplacian weight between the bodies has fallen to 1/e
    posture : of bones and hinges
    trunk_shape : weight on the deformation of each trunk
    root : weight on the displacement of each root from its place in the source
    yielding : factor on person a's root weight, of which b's has the inverse: below 1 a gives way
    acceleration : weight on the acceleration of the displacement, at 30 frames per second
    contact : weight of all contacts of one joint together
    contact_range : metres at which a contact weight has fallen to 1/e
    body_contact : factor on contacts in which no wrist or hand takes part
    smoothing_time : seconds, standard deviation of the filter on Laplacian and contact weights
    stance : weight on the velocity of the displacement of supporting joints, at 30 frames per
        second
    stance_height : weight on the height of supporting joints
    floor_height : weight on the height of joints near the floor
    regularisation : Tikhonov weight on the displacement
    """

    distance_softening: float
    interaction_range: float
    posture: Posture
    trunk_shape: float
    root: float
    yielding: float
    acceleration: float
    contact: float
    contact_range: float
    body_contact: float
    smoothing_time: float
    stance: float
    stance_height: float
    floor_height: float
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
    pair_penalty : ADMM penalty of separation and contact of the two bodies; 0 leaves these
        constraints out, and those of the angles
    tolerance : on the fixed-point residual (``Report.fixed_point_residual``); a body that has not
        converged goes on to the next attempt
    """

    bone_penalty: float
    max_iterations: int
    pair_penalty: float
    tolerance: float


@dataclass(frozen=True, kw_only=True)
class AttemptLimits:
    """Limits within which the result of an attempt is accepted; see ``Report``.

    Parameters
    ----------
    primal_residual : fraction of a bone's length
    contacts_kept : lower limit, fraction
    capsule_penetration : metres, in addition to the source's
    trunk_change : fraction of a distance
    spine_bend : degrees
    seam_ratio : dimensionless
    """

    primal_residual: float
    contacts_kept: float
    capsule_penetration: float
    trunk_change: float
    spine_bend: float
    seam_ratio: float


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of InteractionMesh.

    Parameters
    ----------
    weights : of the energy
    support : criteria of ground support
    limits : within which an attempt is accepted
    attempts : in order, until one is within the limits
    floor_penalty : ADMM penalty of the floor, for joints on it
    separation_stiffness, contact_stiffness : of the elastic bounds between the bodies, to be
        compared with ``weights.contact``; pairs that cannot be kept give way by the forces on them
        over this stiffness
    max_spine_bend : degrees by which a joint of spine or neck may bend more than in the source;
        pelvis and chest are rigid
    max_hinge_bend : degrees by which a knee or elbow may bend, from straight, where it does not
        bend further in the source
    n_pairs : largest number of pairs of bones that are separated in each frame, and of pairs of
        joints that are kept in contact
    near_distance : metres; a pair of joints closer than this in the source counts as near in the
        report
    contact_distance : metres; a pair of joints closer than this is in contact
    contact_slack : metres by which the distance of a preserved contact may grow

    Raises
    ------
    ValueError
        If there is no attempt.
    """

    weights: Weights
    support: Support
    limits: AttemptLimits
    attempts: tuple[Attempt, ...]
    floor_penalty: float
    separation_stiffness: float
    contact_stiffness: float
    max_spine_bend: float
    max_hinge_bend: float
    n_pairs: int
    near_distance: float
    contact_distance: float
    contact_slack: float

    def __post_init__(self) -> None:
        if not self.attempts:
            raise ValueError("attempts must not be empty")
