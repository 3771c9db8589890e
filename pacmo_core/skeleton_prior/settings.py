"""What ``params.yaml`` says about training a skeleton prior."""

from dataclasses import dataclass

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.kinematics import Limb


@dataclass(frozen=True)
class PriorConfig:
    """Which networks, and of what size.

    Parameters
    ----------
    skeleton : of both characters
    limbs : of the skeleton
    model : the name of a skeleton prior in ``pacmo_core.models``
    hidden : channels of the widest layers; of our form a part of them
    stride : frames from one that the networks see to the next
    fps : of the motions learnt from; of others the networks see frames as far apart in time
    dropout : share
    """

    skeleton: Skeleton
    limbs: tuple[Limb, ...]
    model: str
    hidden: int
    stride: int
    fps: float
    dropout: float


@dataclass(frozen=True)
class LossWeights:
    """What each term weighs; the error of joints' places weighs 1.

    The supplement states no loss; these terms are inferred from what it measures.

    Parameters
    ----------
    divergence : of the latents, a mean element
    bones : of the error of bones' lengths
    pairs : of the error of distances between the bodies, near ones first
    distances : of the same, all alike
    acceleration : of the error's second difference
    """

    divergence: float
    bones: float
    pairs: float
    distances: float
    acceleration: float


@dataclass(frozen=True)
class SkeletonPriorSettings:
    """The ``train_skeleton_prior`` section, and the name of the model."""

    random_seed: int
    device: str  # cpu, cuda or auto: cuda where there is one
    mixed_precision: bool  # factors of products in bfloat16 while learning, where the device has it
    model: str  # name of a skeleton prior in pacmo_core.models
    hidden: int  # channels of the widest layers; 256 in the paper's size
    stride: int  # frames from one that the networks see to the next; the change is smooth
    window: int  # frames, so far apart, of a row in a batch
    dropout: float
    weights: LossWeights
    body_steps: int  # in which the prior of bodies learns, before all else
    warmup_epochs: int  # in which the divergence's weight rises to its own
    turn: bool  # show each row from any side
    swap: bool  # let the characters swap roles, where the model knows both bodies
    learning_rate: float
    halve_learning_rate_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights that score best are handed over
    checkpoint_every: int  # epochs

    def __post_init__(self) -> None:
        if min(self.stride, self.body_steps, self.warmup_epochs) < 1:
            raise ValueError(
                "stride, body_steps and warmup_epochs must be at least 1; got "
                f"{self.stride}, {self.body_steps}, {self.warmup_epochs}"
            )
        if self.window < 3:
            raise ValueError(
                f"window must be at least 3, for a second difference; got {self.window}"
            )
