"""What a character's variational auto-encoder is given and gives, whatever is inside."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor, nn

from pacmo_core.skeleton_prior.data import ExampleDataset
from pacmo_core.skeleton_prior.kinematics import KinematicOutput, mesh_root_shift
from pacmo_core.skeleton_prior.settings import PriorConfig


@dataclass(frozen=True)
class CharacterInputs:
    """All that a character's motion rests on.

    Parameters
    ----------
    template : (B, T, J, 3), metres: its own motion at scale 1
    scales : (B, J), of its own bones
    partner : (B, T, J, 3), metres: the partner as it moves by now
    partner_template : (B, T, J, 3), metres
    partner_scales : (B, J)
    unit : metres, the size of changes in the data
    tree : what places joints by bones
    """

    template: Tensor
    scales: Tensor
    partner: Tensor
    partner_template: Tensor
    partner_scales: Tensor
    unit: Tensor
    tree: KinematicOutput

    @cached_property
    def starting_field(self) -> Tensor:
        """``(B, T, J, 3)``: the field of bones that stands before anything is learnt."""
        change = self.partner - self.partner_template
        shift = mesh_root_shift(self.template, self.partner_template, change)
        return self.tree.starting_field(shift, self.template, self.scales)

    @cached_property
    def starting_motion(self) -> Tensor:
        """``(B, T, J, 3)``, metres: where that field places joints."""
        placed: Tensor = self.tree(self.starting_field, self.template, self.scales)
        return placed


@dataclass(frozen=True)
class DiagonalGaussian:
    """A Gaussian over latents: means and logarithms of variances, of one shape."""

    mean: Tensor
    log_variance: Tensor

    def draw(self, random: torch.Generator) -> Tensor:
        """Draw from it, so that gradients reach both."""
        noise = torch.randn(self.mean.shape, generator=random).to(self.mean.device)
        return self.mean + noise * (0.5 * self.log_variance).exp()

    def divergence(self) -> Tensor:
        """Measure its Kullback-Leibler divergence from N(0, I), mean over elements, nats."""
        variance = self.log_variance.exp()
        return 0.5 * (self.mean.square() + variance - 1 - self.log_variance).mean()


class GaussianHead(nn.Module):
    """The two heads of an encoder: the tables have one dense layer where a VAE needs two."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__()
        self.mean = nn.Linear(in_channels, out_channels)
        self.log_variance = nn.Linear(in_channels, out_channels)

    def forward(self, x: Tensor) -> DiagonalGaussian:
        """``(..., C)`` to a code ``(..., D)``."""
        return DiagonalGaussian(self.mean(x), self.log_variance(x).clamp(-10, 4))


class CharacterVae(nn.Module, ABC):
    """One character's VAE; ``place`` is what turns its field into joints' places."""

    place: nn.Module

    @abstractmethod
    def encode(
        self, motion: Tensor, given: CharacterInputs, random: torch.Generator | None
    ) -> DiagonalGaussian:
        """Encode ``(B, T, J, 3)`` metres."""

    @abstractmethod
    def decode(self, latent: Tensor, given: CharacterInputs) -> Tensor:
        """Decode latents into a field ``(B, T, J, 3)``."""

    @abstractmethod
    def latent_shape(self, given: CharacterInputs) -> tuple[int, ...]:
        """Say what shape latents have."""


# FROM """VAE1, the prior of bodies: scales of bones, from sixteen numbers."""
SKELETON_HIDDEN, SKELETON_LATENT = 64, 16
# Scales lie within 1 +- this, or so many times as far as the data's; never as far as none.
SCALE_RANGE, RANGE_MARGIN, MAX_SCALE_RANGE = 0.3, 1.2, 0.95
# To how much of their own length bones are to come back: less, and draws vary less than the data.
SCALE_STD = 3e-3
SKELETON_BATCH_SIZE, SKELETON_LEARNING_RATE = 64, 2e-3


class SkeletonVae(nn.Module):
    """MLP1 and MLP2, for which the supplement gives no table: n -> 64 -> 16 -> 64 -> n.

    Parameters
    ----------
    n_joints : with the root, whose scale is 1
    root : its index
    """

    reach: Tensor

    def __init__(self, n_joints: int, root: int) -> None:
        super().__init__()
        self.root = root
        self.register_buffer("reach", torch.tensor(SCALE_RANGE))
        self.into = nn.Linear(n_joints, SKELETON_HIDDEN)
        self.code = GaussianHead(SKELETON_HIDDEN, SKELETON_LATENT)
        self.out = nn.Sequential(
            nn.Linear(SKELETON_LATENT, SKELETON_HIDDEN),
            nn.ReLU(),
            nn.Linear(SKELETON_HIDDEN, n_joints),
        )

    def encode(self, scales: Tensor) -> DiagonalGaussian:
        """Encode (B, J)."""
        code: DiagonalGaussian = self.code(torch.relu(self.into((scales - 1) / self.reach)))
        return code

    def decode(self, latent: Tensor) -> Tensor:
        """Decode (B, 16) to scales (B, J), all of them positive."""
        scales = 1 + self.reach * torch.tanh(self.out(latent))
        at_root = torch.arange(scales.shape[1], device=scales.device) == self.root
        return torch.where(at_root, 1.0, scales)

    def sample(self, n: int, random: torch.Generator) -> Tensor:
        """Draw n bodies, (n, J)."""
        latent = torch.randn(n, SKELETON_LATENT, generator=random)
        return self.decode(latent.to(self.into.weight.device))


def fit_skeleton_vae(
    bodies: SkeletonVae, scales: Tensor, *, n_steps: int, random: torch.Generator
) -> None:
    """Learn the bodies of the data, in place, by the evidence lower bound; no more after that.

    By itself: it shares nothing with the characters, and in the few steps that a small set gives
    them its draws would stay what its weights began with.

    Parameters
    ----------
    scales : (N, J)
    """
    furthest = RANGE_MARGIN * (scales - 1).abs().max()
    bodies.reach.copy_(furthest.clamp(SCALE_RANGE, MAX_SCALE_RANGE))
    optimiser = torch.optim.Adam(bodies.parameters(), lr=SKELETON_LEARNING_RATE)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, n_steps)
    for _ in range(n_steps):
        batch = scales[torch.randint(len(scales), (SKELETON_BATCH_SIZE,), generator=random)]
        code = bodies.encode(batch)
        errors = (bodies.decode(code.draw(random)) - batch) / SCALE_STD
        loss = 0.5 * errors.square().sum(dim=1).mean() + SKELETON_LATENT * code.divergence()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]  # torch leaves it untyped
        optimiser.step()
        slower.step()
    bodies.requires_grad_(False)


# FROM """The three VAEs as one model: bodies, the first character, the second given the first."""
@dataclass(frozen=True)
class Reconstruction:
    """What came of a pass with its latents.

    Parameters
    ----------
    motions : (B, T, 2, J, 3), metres, the first character first
    codes : of both
    """

    motions: Tensor
    codes: tuple[DiagonalGaussian, DiagonalGaussian]


# Metres: below this a change is none.
MIN_DISPLACEMENT_SCALE = 1e-4


class SkeletonPrior(nn.Module):
    """``p(bodies) p(first | bodies) p(second | first, bodies)`` (supplement, 2.3).

    Parameters
    ----------
    config : PriorConfig
    characters : the first and the second
    both_roles : whether a character can be told both bodies, so that training may swap roles
    """

    unit: Tensor

    def __init__(
        self,
        config: PriorConfig,
        characters: tuple[CharacterVae, CharacterVae],
        *,
        both_roles: bool,
    ) -> None:
        super().__init__()
        self.config, self.both_roles = config, both_roles
        self.bodies = SkeletonVae(len(config.skeleton.joints), config.skeleton.root)
        self.first, self.second = characters
        self.tree = KinematicOutput(config.skeleton, config.limbs)
        self.register_buffer("unit", torch.ones(()))

    def measure(self, examples: ExampleDataset) -> None:
        """Take the unit of changes from data: their root mean square, metres."""
        squares = [
            (varied - examples.templates[source]).square().mean()
            for varied, source in zip(examples.varied, examples.sources.tolist(), strict=True)
        ]
        self.unit.copy_(torch.stack(squares).mean().sqrt().clamp_min(MIN_DISPLACEMENT_SCALE))

    def reconstruct(
        self, template: Tensor, scales: Tensor, varied: Tensor, random: torch.Generator
    ) -> Reconstruction:
        """Encode variations and decode them; the second character is told the true first.

        Parameters
        ----------
        template, varied : (B, T, 2, J, 3), metres
        scales : (B, 2, J)
        """
        given = self.given_first(template, scales)
        code = self.first.encode(varied[:, :, 0], given, random)
        first = self._place(self.first, self.first.decode(code.draw(random), given), given)
        after = self.given_second(template, scales, varied[:, :, 0])
        other = self.second.encode(varied[:, :, 1], after, random)
        second = self._place(self.second, self.second.decode(other.draw(random), after), after)
        return Reconstruction(torch.stack([first, second], dim=2), (code, other))

    def fields(
        self, template: Tensor, scales: Tensor, latents: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, Tensor]:
        """Decode both characters from the prior, the second from what the first came to.

        Returns
        -------
        two fields (B, T, J, 3), for ``place``
        """
        given = self.given_first(template, scales)
        first = self.first.decode(latents[0], given)
        after = self.given_second(template, scales, self._place(self.first, first, given))
        return first, self.second.decode(latents[1], after)

    def place(self, fields: tuple[Tensor, Tensor], template: Tensor, scales: Tensor) -> Tensor:
        """Place both, (B, T, 2, J, 3) metres, at the fields' own rate or any other."""
        first, second = (
            character.place(field, template[:, :, role], scales[:, role])
            for role, (character, field) in enumerate(
                zip((self.first, self.second), fields, strict=True)
            )
        )
        return torch.stack([first, second], dim=2)

    def latents(
        self, template: Tensor, scales: Tensor, random: torch.Generator | None
    ) -> tuple[Tensor, Tensor]:
        """Draw latents of both characters from N(0, I), or take its mean."""
        given = self.given_first(template, scales)
        first, second = (
            sample_prior(character.latent_shape(given), random).to(template.device)
            for character in (self.first, self.second)
        )
        return first, second

    def given_first(self, template: Tensor, scales: Tensor) -> CharacterInputs:
        """Tell the first character all but what its partner will do: of that it has a guess."""
        partner = self.tree.guess(template[:, :, 1], scales[:, 1])
        return self._given(template, scales, partner, role=0)

    def given_second(self, template: Tensor, scales: Tensor, first: Tensor) -> CharacterInputs:
        """Tell the second character what the first does."""
        return self._given(template, scales, first, role=1)

    def _given(
        self, template: Tensor, scales: Tensor, partner: Tensor, *, role: int
    ) -> CharacterInputs:
        other = 1 - role
        return CharacterInputs(
            template[:, :, role],
            scales[:, role],
            partner,
            template[:, :, other],
            scales[:, other],
            self.unit,
            self.tree,
        )

    def _place(self, character: CharacterVae, field: Tensor, given: CharacterInputs) -> Tensor:
        placed: Tensor = character.place(field, given.template, given.scales)
        return placed


def sample_prior(shape: tuple[int, ...], random: torch.Generator | None) -> Tensor:
    """Draw from N(0, I), or give its mean."""
    return torch.zeros(shape) if random is None else torch.randn(shape, generator=random)
