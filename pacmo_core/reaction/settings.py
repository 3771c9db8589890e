"""What ``params.yaml`` says about training: one class a section, key for key."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AutoencoderSettings:
    """The ``train_autoencoder`` section."""

    random_seed: int
    device: str  # cpu, cuda or auto: cuda where there is one
    n_points: int  # grid on [0, 1]; period * (n_points - 1) is the latent grid
    period: float  # of the latent grid, longer than 1
    width: int  # channels of the lifted function
    bottleneck: int  # channels of the feature functions
    modes: list[int]  # of the seven layers
    learning_rate: float
    halve_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights that score best are handed over
    checkpoint_every: int  # epochs
    swap: bool  # show each interaction from both sides


@dataclass(frozen=True)
class GruSettings:
    """The ``train_gru`` section."""

    random_seed: int
    device: str  # cpu, cuda or auto: cuda where there is one
    fps: float  # the one rate at which the recurrence runs
    hidden: int
    n_layers: int
    learning_rate: float
    halve_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights that score best are handed over
    checkpoint_every: int  # epochs
    swap: bool


@dataclass(frozen=True)
class AdamSettings:
    """How Adam moves one of two networks."""

    learning_rate: float
    betas: tuple[float, float]


@dataclass(frozen=True)
class AugmentationSettings:
    """How captures are changed on their way into a batch; see ``augment.Augment``.

    Parameters
    ----------
    mirror : share of interactions shown as their mirror image
    size : standard deviation of the logarithm of both people's size
    turn : standard deviation of the turn of the partner's frame, radians
    least_rate : share of the grid's points, from which up the partner's frame rate is drawn
    """

    mirror: float
    size: float
    turn: float
    least_rate: float

    def __post_init__(self) -> None:
        if not (0 <= self.mirror <= 1 and self.size >= 0 and self.turn >= 0):
            raise ValueError(f"mirror must lie in [0, 1], size and turn not below 0; got {self}")
        if not 0 < self.least_rate <= 1:
            raise ValueError(f"least_rate must lie in (0, 1]; got {self.least_rate}")


@dataclass(frozen=True)
class RegressionSettings:
    """The ``train_regression`` section."""

    random_seed: int
    device: str  # cpu, cuda or auto: cuda where there is one
    n_points: int
    period: float
    width: int
    modes: list[int]
    learning_rate: float
    halve_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights that score best are handed over
    checkpoint_every: int  # epochs
    swap: bool
    augment: AugmentationSettings


@dataclass(frozen=True)
class PacmoSettings:
    """The ``train_pacmo`` section."""

    random_seed: int
    device: str  # cpu, cuda or auto: cuda where there is one
    n_points: int
    period: float
    width: int
    modes: list[int]
    noise_channels: int
    noise_modes: int
    noise_alpha: float
    noise_tau: float
    functional_hidden: int  # units of the critic's kernel network
    body_distances: bool  # show the critic the distances from body to body
    action_channels: int  # of functions of the action's label; 0: the partner is all it is told
    generator: AdamSettings
    critic: AdamSettings
    halve_every: int  # epochs
    batch_size: int
    n_epochs: int  # in each the critic sees about as many pairs as there are
    validate_every: int  # epochs; the weights that score best are handed over
    checkpoint_every: int  # epochs
    validate_from: int  # epochs; earlier weights are not handed over
    validation_samples: int  # reactions to a held-out partner, for the energy score
    n_critic: int  # steps of the critic for each of the generator's
    penalty_weight: float  # of the gradient penalty (PaCMO, eq. 2)
    warmup_epochs: int  # in which the generator follows the energy score alone
    score_weight: float  # of the energy score; 0 is the paper's plain form
    score_spread: float  # share of its term for spread; below 1 reactions are truer, less varied
    symmetry_weight: float  # of the squared difference of mirror bones, 1 / m^2
    bone_weight: float  # of the variance over time of the bones' lengths, 1 / m^2; 0 is off
    ema: float  # share of the running mean that stays each step
    swap: bool
    augment: AugmentationSettings
    mixed_precision: bool  # bfloat16 in the networks, on a GPU only
    compile_generator: bool  # on a GPU only

    def __post_init__(self) -> None:
        if self.warmup_epochs and not self.score_weight:
            raise ValueError(
                f"warmup_epochs {self.warmup_epochs} want a score_weight: "
                "without it the generator has nothing to follow"
            )
        if not 0 <= self.warmup_epochs <= self.validate_from < self.n_epochs:
            raise ValueError(
                "wanted 0 <= warmup_epochs <= validate_from < n_epochs; "
                f"got {self.warmup_epochs}, {self.validate_from}, {self.n_epochs}"
            )


@dataclass(frozen=True)
class MatcherSettings:
    """The ``train_matcher`` section."""

    random_seed: int
    device: str  # cpu, cuda or auto: cuda where there is one
    n_points: int  # grid on [0, 1]
    period: float
    width: int
    modes: list[int]  # of the three layers
    embedding: int  # channels of the functions that are compared
    n_instants: int  # at which they are
    temperature: float  # of the choice: small is sharp
    noise: float  # metres, whole bodies moved at random while training
    learning_rate: float
    halve_every: int  # epochs
    batch_size: int
    n_epochs: int
    validate_every: int  # epochs; the weights that score best are handed over
    checkpoint_every: int  # epochs
    mirror: bool  # show each interaction mirrored too
