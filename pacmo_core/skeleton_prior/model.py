"""The three VAEs as one model: bodies, the first character, the second given the first."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from pacmo_core.data.skeleton import Skeleton
from pacmo_core.skeleton_prior.bodies import Bodies
from pacmo_core.skeleton_prior.character import Character, Code, Given
from pacmo_core.skeleton_prior.examples import ExampleSet
from pacmo_core.skeleton_prior.limbs import Limb
from pacmo_core.skeleton_prior.placing import Tree


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
class Answer:
    """What came of a pass with its latents.

    Parameters
    ----------
    motions : (B, T, 2, J, 3), metres, the first character first
    codes : of both
    """

    motions: Tensor
    codes: tuple[Code, Code]


# Metres: below this a change is none.
SMALLEST_UNIT = 1e-4


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
        self, config: PriorConfig, characters: tuple[Character, Character], *, both_roles: bool
    ) -> None:
        super().__init__()
        self.config, self.both_roles = config, both_roles
        self.bodies = Bodies(len(config.skeleton.joints), config.skeleton.root)
        self.first, self.second = characters
        self.tree = Tree(config.skeleton, config.limbs)
        self.register_buffer("unit", torch.ones(()))

    def measure(self, examples: ExampleSet) -> None:
        """Take the unit of changes from data: their root mean square, metres."""
        squares = [
            (varied - examples.templates[source]).square().mean()
            for varied, source in zip(examples.varied, examples.sources.tolist(), strict=True)
        ]
        self.unit.copy_(torch.stack(squares).mean().sqrt().clamp_min(SMALLEST_UNIT))

    def reconstruct(
        self, template: Tensor, scales: Tensor, varied: Tensor, random: torch.Generator
    ) -> Answer:
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
        return Answer(torch.stack([first, second], dim=2), (code, other))

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
            draw(character.latent_shape(given), random).to(template.device)
            for character in (self.first, self.second)
        )
        return first, second

    def given_first(self, template: Tensor, scales: Tensor) -> Given:
        """Tell the first character all but what its partner will do: of that it has a guess."""
        partner = self.tree.guess(template[:, :, 1], scales[:, 1])
        return self._given(template, scales, partner, role=0)

    def given_second(self, template: Tensor, scales: Tensor, first: Tensor) -> Given:
        """Tell the second character what the first does."""
        return self._given(template, scales, first, role=1)

    def _given(self, template: Tensor, scales: Tensor, partner: Tensor, *, role: int) -> Given:
        other = 1 - role
        return Given(
            template[:, :, role],
            scales[:, role],
            partner,
            template[:, :, other],
            scales[:, other],
            self.unit,
            self.tree,
        )

    def _place(self, character: Character, field: Tensor, given: Given) -> Tensor:
        placed: Tensor = character.place(field, given.template, given.scales)
        return placed


def draw(shape: tuple[int, ...], random: torch.Generator | None) -> Tensor:
    """Draw from N(0, I), or give its mean."""
    return torch.zeros(shape) if random is None else torch.randn(shape, generator=random)
