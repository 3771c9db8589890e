"""Settings of the trainings: a dataclass for each section of ``params.yaml``, key for key.

Settings that contradict each other are refused here, in one line, before any data are read.
"""

from dataclasses import dataclass
from typing import Any

# Numbers of every training that are at least 1.
LOOP_COUNTS = (
    "n_epochs",
    "validate_every",
    "checkpoint_every",
    "halve_learning_rate_every",
    "batch_size",
)


@dataclass(frozen=True)
class AutoencoderSettings:
    """The ``train_autoencoder`` section."""

    random_seed: int
    device: str  # cpu, cuda, or auto: cuda where available
    n_points: int  # grid on [0, 1]; period * (n_points - 1) is the latent grid
    period: float  # of the latent grid, longer than 1
    width: int  # channels of the lifted function
    bottleneck_channels: int  # channels of the feature functions
    modes: list[int]  # of the seven layers
    learning_rate: float
    halve_learning_rate_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights of the best validation score are kept
    checkpoint_every: int  # epochs
    both_directions: bool  # train on each interaction with either person as the partner

    def __post_init__(self) -> None:
        check_positive(self, *LOOP_COUNTS)


JOINT_ERRORS = ("joint_offset", "joint_noise")


@dataclass(frozen=True)
class AugmentationSettings:
    """Random augmentation of training pairs; see ``data.RandomAugmentation``.

    Parameters
    ----------
    mirror_probability : of showing an interaction as its mirror image
    size_spread : standard deviation of the logarithm of both people's size
    rotation_spread : standard deviation of a rotation about the vertical axis, radians
    min_rate : lowest frame rate of the partner, as a share of the grid's points
    tempo_spread : standard deviation of the logarithm of the duration
    joint_offset : metres, standard deviation of the partner's joints from where others put them
    joint_noise : metres, mean standard deviation of the partner's joints from one time to the next
    """

    mirror_probability: float
    size_spread: float
    rotation_spread: float
    min_rate: float
    tempo_spread: float
    joint_offset: float
    joint_noise: float

    def __post_init__(self) -> None:
        if not 0 <= self.mirror_probability <= 1:
            raise ValueError(f"mirror_probability must be in [0, 1]; got {self.mirror_probability}")
        for name in ("size_spread", "rotation_spread", "tempo_spread", *JOINT_ERRORS):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must be at least 0; got {getattr(self, name)}")
        if not 0 < self.min_rate <= 1:
            raise ValueError(f"min_rate must be in (0, 1]; got {self.min_rate}")


@dataclass(frozen=True)
class PartsSettings:
    """Random parts of training clips; see ``data.with_random_parts``.

    Parameters
    ----------
    n : of each clip; 0: none
    min_share, max_share : of a clip's frames, from the shortest part to the longest
    random_seed : of their lengths and places
    """

    n: int
    min_share: float
    max_share: float
    random_seed: int

    def __post_init__(self) -> None:
        if self.n < 0 or not 0 < self.min_share <= self.max_share <= 1:
            raise ValueError(
                "wanted n at least 0 and 0 < min_share <= max_share <= 1; got "
                f"{self.n}, {self.min_share}, {self.max_share}"
            )


@dataclass(frozen=True)
class GruSettings:
    """The ``train_gru`` section."""

    random_seed: int
    device: str  # cpu, cuda, or auto: cuda where available
    fps: float  # frame rate of the recurrent network
    hidden: int
    n_layers: int
    learning_rate: float
    halve_learning_rate_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights of the best validation score are kept
    checkpoint_every: int  # epochs
    both_directions: bool
    parts: PartsSettings  # of the clips, shown beside them
    augmentation: AugmentationSettings

    def __post_init__(self) -> None:
        check_positive(self, *LOOP_COUNTS)
        if (self.augmentation.min_rate, self.augmentation.tempo_spread) != (1, 0):
            raise ValueError(
                "a recurrence has one frame rate: wanted an augmentation with min_rate 1 and "
                f"tempo_spread 0; got {self.augmentation.min_rate} and "
                f"{self.augmentation.tempo_spread}"
            )


@dataclass(frozen=True)
class AdamSettings:
    """Learning rate and moment decay rates (beta 1, beta 2) of Adam for one network."""

    learning_rate: float
    betas: tuple[float, float]


@dataclass(frozen=True)
class ContactScoreSettings:
    """Weights and scales of ``energy_score.ContactScore``; a weight of 0 turns a function off.

    Parameters
    ----------
    near_weight : of ``exp(-distance / near_distance)``, relative to the score of the motion
    near_distance : metres between joints of the two people
    log_distance_weight : of the logarithm of these distances
    approach_weight : of the logarithm of an end effector's least distance to the other's body
    stance_weight : of ``exp(-speed / stance_speed)`` of the feet
    stance_speed : metres per second
    spread : factor of the spread term in training; below 1, samples agree more on contacts
    """

    near_weight: float
    near_distance: float
    log_distance_weight: float
    approach_weight: float
    stance_weight: float
    stance_speed: float
    spread: float

    def __post_init__(self) -> None:
        if not (self.near_distance > 0 and self.stance_speed > 0):
            raise ValueError(
                "near_distance and stance_speed must be greater than 0; "
                f"got {self.near_distance} and {self.stance_speed}"
            )

    @property
    def is_used(self) -> bool:
        """Whether any weight is not 0."""
        weights = (self.near_weight, self.log_distance_weight, self.approach_weight)
        return any((*weights, self.stance_weight))


@dataclass(frozen=True)
class RegressionSettings:
    """The ``train_regression`` section."""

    random_seed: int
    device: str  # cpu, cuda, or auto: cuda where available
    n_points: int
    period: float
    width: int
    modes: list[int]
    learning_rate: float
    halve_learning_rate_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights of the best validation score are kept
    checkpoint_every: int  # epochs
    both_directions: bool
    parts: PartsSettings  # of the clips, shown beside them
    augmentation: AugmentationSettings

    def __post_init__(self) -> None:
        check_positive(self, *LOOP_COUNTS)


@dataclass(frozen=True)
class FlowMatchingSettings(RegressionSettings):
    """The ``train_flow_matching`` section: a regression's, of the operator of a flow."""

    noise_modes: int  # of the random field at which a flow starts
    noise_alpha: float
    noise_tau: float
    noise_period: float
    noise_scale: float  # its standard deviation, relative to that of reactions
    n_steps: int  # of the integration that gives a reaction

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "n_steps")
        if not self.noise_scale > 0:
            raise ValueError(f"noise_scale must be greater than 0; got {self.noise_scale}")


@dataclass(frozen=True)
class FineTuningSettings:
    """Weights of a generator that a training continues from, as on captures of one's own.

    Its normalisation is taken over too, and with it the durations that ``react`` does not divide
    into windows, and so is its finish. The critic begins with random weights.

    Parameters
    ----------
    weights : file of a PaCMO of the same joints, noise and operator; empty: random weights
    sha256 : of the file, so that settings say all that a training depends on
    share : of the values of these weights in those of the trained model: their mean makes fewer
        false contacts with other people than the trained weights alone, and places reactions less
        exactly (Wortsman et al. 2022, Robust fine-tuning of zero-shot models)
    """

    weights: str
    sha256: str
    share: float

    def __post_init__(self) -> None:
        if not 0 <= self.share < 1:
            raise ValueError(f"share must be in [0, 1); got {self.share}")
        if bool(self.weights) != bool(self.sha256):
            raise ValueError(
                "weights and sha256 must both be stated, or none; got "
                f"{self.weights!r} and {self.sha256!r}"
            )


@dataclass(frozen=True)
class PacmoSettings:
    """The ``train_pacmo`` section."""

    random_seed: int
    start: FineTuningSettings
    device: str  # cpu, cuda, or auto: cuda where available
    n_points: int
    period: float
    width: int
    modes: list[int]
    noise_channels: int
    noise_modes: int
    noise_alpha: float
    noise_tau: float
    functional_hidden: int  # units of the critic's kernel network
    body_distances: bool  # give the critic the distances between end effectors of the two bodies
    action_channels: int  # of the action label's embedding; 0: the partner is the only condition
    action_dropout: float  # share of training pairs whose label is withheld
    generator: AdamSettings
    critic: AdamSettings
    halve_learning_rate_every: int  # epochs
    cooldown_epochs: int  # last epochs, in which the generator's learning rate falls towards 0
    batch_size: int
    n_epochs: int  # in each the critic is trained on about as many pairs as there are
    validate_every: int  # epochs; the weights of the best validation score are kept
    checkpoint_every: int  # epochs
    validate_from: int  # epochs; no weights of earlier epochs are selected
    validation_samples: int  # reactions to each validation partner, for the energy score
    temperatures: list[float]  # of the noise, of which the one with the best validation is kept
    n_critic: int  # critic steps for each generator step; 0: the generator has no critic
    gradient_penalty_weight: float  # lambda of the gradient penalty (PaCMO, eq. 2)
    warmup_epochs: int  # in which the generator is trained on the energy score, without the critic
    energy_score_weight: float  # of the energy score in the generator's loss; 0 in the paper
    contact_score: ContactScoreSettings  # what the energy score includes beside the motion
    bone_symmetry_weight: float  # of the squared length difference of mirrored bones, 1 / m^2
    bone_length_weight: float  # of the variance over time of the bones' lengths, 1 / m^2; 0 is off
    ema_decay: float  # of the exponential moving average of the weights, a step
    both_directions: bool
    parts: PartsSettings  # of the clips, shown beside them
    augmentation: AugmentationSettings
    mixed_precision: bool  # bfloat16 in the networks, on a GPU only
    compile_generator: bool  # on a GPU only

    def __post_init__(self) -> None:
        check_positive(self, *LOOP_COUNTS)
        self._check_numbers()
        if self.n_critic < 0 or not (self.n_critic or self.energy_score_weight):
            raise ValueError(
                "n_critic must be at least 0, and 0 wants an energy_score_weight above 0: the "
                f"generator has no other loss on reactions; got n_critic {self.n_critic}, "
                f"energy_score_weight {self.energy_score_weight}"
            )
        if not 0 <= self.validate_from < self.n_epochs:
            raise ValueError(
                "validate_from must be at least 0 and less than n_epochs: weights are selected in "
                f"the epochs after it; got validate_from {self.validate_from}, "
                f"n_epochs {self.n_epochs}"
            )
        if not 0 <= self.warmup_epochs <= self.validate_from:
            raise ValueError(
                "warmup_epochs must be at least 0 and at most validate_from; got warmup_epochs "
                f"{self.warmup_epochs}, validate_from {self.validate_from}"
            )
        if not self.temperatures or min(self.temperatures) <= 0:
            raise ValueError(f"temperatures must be one or more, above 0; got {self.temperatures}")
        if not 0 <= self.cooldown_epochs <= self.n_epochs:
            raise ValueError(
                "cooldown_epochs must be at least 0 and at most n_epochs; got cooldown_epochs "
                f"{self.cooldown_epochs}, n_epochs {self.n_epochs}"
            )
        if self.warmup_epochs and not self.energy_score_weight:
            raise ValueError(
                "warmup_epochs above 0 want an energy_score_weight above 0: the generator has no "
                f"other loss on reactions; got warmup_epochs {self.warmup_epochs}, "
                f"energy_score_weight {self.energy_score_weight}"
            )
        self._check_labels()

    def _check_numbers(self) -> None:
        for name in ("n_points", "validation_samples"):  # a grid; an energy score
            if getattr(self, name) < 2:
                raise ValueError(f"{name} must be at least 2; got {getattr(self, name)}")
        for name in ("gradient_penalty", "energy_score", "bone_symmetry", "bone_length"):
            weight = getattr(self, f"{name}_weight")
            if weight < 0:
                raise ValueError(f"{name}_weight must be at least 0; got {weight}")
        if not 0 <= self.ema_decay < 1:
            raise ValueError(f"ema_decay must be at least 0 and less than 1; got {self.ema_decay}")

    def _check_labels(self) -> None:
        if not 0 <= self.action_dropout < 1 or (self.action_dropout and not self.action_channels):
            raise ValueError(
                "action_dropout must be at least 0 and less than 1, and above 0 it wants "
                f"action_channels above 0; got {self.action_dropout}, "
                f"action_channels {self.action_channels}"
            )


@dataclass(frozen=True)
class MatcherSettings:
    """The ``train_matcher`` section."""

    random_seed: int
    device: str  # cpu, cuda, or auto: cuda where available
    n_points: int  # grid on [0, 1]
    period: float
    width: int
    modes: list[int]  # of the three layers
    embedding_channels: int  # of the functions of time that partner and reaction are embedded as
    n_times: int  # at which the embedding is evaluated
    temperature: float  # of the softmax: smaller is sharper
    joint_noise: float  # metres, standard deviation of a constant offset of each joint
    learning_rate: float
    halve_learning_rate_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights of the best validation score are kept
    checkpoint_every: int  # epochs
    mirror: bool  # add the mirror image of each interaction

    def __post_init__(self) -> None:
        check_positive(self, *LOOP_COUNTS)


def check_positive(settings: Any, *names: str) -> None:
    """Refuse counts below 1.

    Raises
    ------
    ValueError
        Naming the first of ``names`` that is below 1, and its value.
    """
    for name in names:
        if getattr(settings, name) < 1:
            raise ValueError(f"{name} must be at least 1; got {getattr(settings, name)}")
