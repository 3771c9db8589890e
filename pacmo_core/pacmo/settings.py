"""What ``params.yaml`` says about training: one class a section, key for key."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AutoencoderSettings:
    """The ``train_autoencoder`` section."""

    random_seed: int
    n_points: int  # grid on [0, 1]; period * (n_points - 1) is the latent grid
    period: float  # of the latent grid, longer than 1
    width: int  # channels of the lifted function
    bottleneck: int  # channels of the feature functions
    modes: list[int]  # of the seven layers
    learning_rate: float
    halve_every: int  # epochs
    batch_size: int
    n_epochs: int
    swap: bool  # show each interaction from both sides


@dataclass(frozen=True)
class GruSettings:
    """The ``train_gru`` section."""

    random_seed: int
    fps: float  # the one rate at which the recurrence runs
    hidden: int
    n_layers: int
    learning_rate: float
    halve_every: int  # epochs
    batch_size: int
    n_epochs: int
    swap: bool


@dataclass(frozen=True)
class PacmoSettings:
    """The ``train_pacmo`` section."""

    random_seed: int
    n_points: int
    period: float
    width: int
    modes: list[int]
    noise_channels: int
    noise_modes: int
    noise_alpha: float
    noise_tau: float
    functional_hidden: int  # units of the critic's kernel network
    learning_rate: float
    betas: list[float]  # of Adam
    halve_every: int  # steps
    batch_size: int
    n_steps: int  # of the generator
    n_critic: int  # steps of the critic for each of the generator's
    penalty_weight: float  # of the gradient penalty (PaCMO, eq. 2)
    symmetry_weight: float  # of the squared difference of mirror bones, 1 / m^2
    ema: float  # share of the running mean that stays each step
    swap: bool


@dataclass(frozen=True)
class MatcherSettings:
    """The ``train_matcher`` section."""

    random_seed: int
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
    mirror: bool  # show each interaction mirrored too
