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
    learning_rate: float
    betas: list[float]  # of Adam
    halve_every: int  # epochs
    batch_size: int
    n_epochs: int  # in each the critic sees about as many pairs as there are
    validate_every: int  # epochs; the weights that score best are handed over
    checkpoint_every: int  # epochs
    validation_samples: int  # reactions to a held-out partner, for the energy score
    n_critic: int  # steps of the critic for each of the generator's
    penalty_weight: float  # of the gradient penalty (PaCMO, eq. 2)
    symmetry_weight: float  # of the squared difference of mirror bones, 1 / m^2
    bone_weight: float  # of the variance over time of the bones' lengths, 1 / m^2; 0 is off
    ema: float  # share of the running mean that stays each step
    swap: bool
    mixed_precision: bool  # bfloat16 in the networks, on a GPU only
    compile_generator: bool  # on a GPU only
