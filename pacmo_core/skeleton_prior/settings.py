"""Settings of the training, and the configuration that is stored beside a model's weights."""

from dataclasses import dataclass

from pacmo_core.data.limits import MAX_PARAMETERS
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import Limb


@dataclass(frozen=True)
class StartSettings:
    """Constants of the rule in ``start``; weights of a limb's end are against 1 for its posture."""

    ground_height: float  # metres above the ground at which a limb end's weight has fallen to 1/e
    contact_range: float  # metres at which the contact weight of two joints has fallen to 1/e
    root: float  # weights for the body as a whole: of staying in place,
    ground: float  # of the height of limb ends near the ground,
    contact: float  # of contacts
    foot: float  # weights for a limb's end: of the ground,
    hand: float  # of contacts
    yielding: float  # share of the contact weights if the partner is expected to yield too


@dataclass(frozen=True)
class PriorConfig:
    """Architecture of a skeleton prior."""

    skeleton: Skeleton  # of both characters
    limbs: tuple[Limb, ...]  # its arms and legs
    model: str  # a skeleton prior of pacmo_core.models
    hidden: int  # channels of the widest layers; ``kinematic`` uses a quarter of them
    frame_stride: int  # frames between keyframes; the networks see keyframes only
    fps: float  # of the training motions; keyframes of other motions are as far apart in time
    start: StartSettings  # of the kinematic model

    def __post_init__(self) -> None:
        n_joints = len(self.skeleton.joints)
        outside = [joint for limb in self.limbs for joint in limb if not 0 <= joint < n_joints]
        if outside or not self.fps > 0 or min(self.hidden, self.frame_stride) < 1:
            raise ValueError(
                "limbs must be joints, fps > 0, hidden and frame_stride >= 1; "
                f"got {outside}, {self.fps}, {self.hidden}, {self.frame_stride}"
            )
        if n_joints * self.hidden**2 > MAX_PARAMETERS:
            raise ValueError(f"hidden must be smaller with {n_joints} joints; got {self.hidden}")


@dataclass(frozen=True)
class LossWeights:
    """Weights of the loss terms; the position error weighs 1.

    The supplement states no loss. The terms follow from the metrics that it reports.
    """

    kl_divergence: float  # of the posteriors from N(0, I), mean over latent elements
    bone_length: float  # error of bone lengths
    contact_distance: float  # of distances between the two people's joints, weighted by proximity
    joint_distance: float  # the same error, unweighted
    acceleration: float  # second difference of the position error over time
    energy_score: float  # of two samples from the latents' prior; 0 leaves it out


@dataclass(frozen=True)
class SkeletonPriorSettings:
    """The ``train_skeleton_prior`` section of ``params.yaml``, and the name of the model."""

    random_seed: int
    device: str  # cpu, cuda or auto: cuda where there is one
    model: str  # a skeleton prior of pacmo_core.models
    hidden: int  # channels of the widest layers; 256 in the paper
    frame_stride: int  # frames between keyframes; displacements are smooth in time
    window_frames: int  # keyframes of a training window
    start: StartSettings  # of the kinematic model
    loss_weights: LossWeights
    skeleton_vae_steps: int  # training steps of the skeleton VAE, before the motion VAEs
    kl_warmup_epochs: int  # in which the weight of the KL divergence rises to its full value
    random_rotation: bool  # rotate each window about the vertical
    mirror_probability: float  # of mirroring a window
    used_share: float  # of windows that are decoded as in use: from the latents' prior mean
    swap_characters: bool  # swap the characters at random, in models that take both skeletons
    learning_rate: float  # of Adam
    halve_learning_rate_every: int  # epochs
    batch_size: int  # windows
    n_epochs: int
    validate_every: int  # epochs; the weights of the lowest validation error are selected
    checkpoint_every: int  # epochs

    def __post_init__(self) -> None:
        if min(self.frame_stride, self.skeleton_vae_steps, self.kl_warmup_epochs) < 1:
            raise ValueError(
                "frame_stride, skeleton_vae_steps and kl_warmup_epochs must be at least 1; got "
                f"{self.frame_stride}, {self.skeleton_vae_steps}, {self.kl_warmup_epochs}"
            )
        if self.window_frames < 3:
            raise ValueError(
                f"window_frames must be at least 3, for a second difference over time; got "
                f"{self.window_frames}"
            )
