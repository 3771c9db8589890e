"""Several natural motions of one pair of bodies: the solver's weights, drawn anew for each.

That a taller person shakes hands with a shorter one can be solved in several ways: one of the two
gives way or the other, the pair steps or reaches, arms bend or the trunk does. The weights of the
solver decide which. Each way is a draw of three factors on them.
"""

import hashlib
from dataclasses import dataclass, replace

import numpy as np

from pacmo_core.interaction_mesh import Settings


@dataclass(frozen=True, kw_only=True)
class SolutionSettings:
    """How many solutions there are of each pair of bodies, and how they differ.

    Parameters
    ----------
    n : solutions; the first has the weights of the solver's settings
    yielding, root, limbs : standard deviations of the logarithms of the factors of ``Solution``
    random_seed : int

    Raises
    ------
    ValueError
        If there is no solution, or a standard deviation is negative.
    """

    n: int
    yielding: float
    root: float
    limbs: float
    random_seed: int

    def __post_init__(self) -> None:
        if self.n < 1:
            raise ValueError(f"solutions.n must be at least 1; got {self.n}")
        for name in ("yielding", "root", "limbs"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"solutions.{name} must be at least 0; got {getattr(self, name)}")


@dataclass(frozen=True)
class Solution:
    """Factors on the solver's weights; those of the first solution are 1.

    Parameters
    ----------
    number : of the solution, from 0
    yielding : on the root weight of person a, of which b's has the inverse: below 1 a gives way
    root : on the root weights of both: below 1 they step rather than reach
    limbs : on the posture of limbs, of which that of trunk and spine has the inverse: below 1 arms
        give way before the trunk does
    """

    number: int = 0
    yielding: float = 1.0
    root: float = 1.0
    limbs: float = 1.0

    def apply(self, settings: Settings) -> Settings:
        """Return the solver's settings with the factors."""
        weights, posture = settings.weights, settings.weights.posture
        return replace(
            settings,
            weights=replace(
                weights,
                yielding=weights.yielding * self.yielding,
                root=weights.root * self.root,
                posture=replace(
                    posture,
                    upper_limb=posture.upper_limb * self.limbs,
                    forearm=posture.forearm * self.limbs,
                    elbow=posture.elbow * self.limbs,
                    trunk=posture.trunk / self.limbs,
                    spine=posture.spine / self.limbs,
                ),
            ),
        )


OWN_WEIGHTS = Solution()


def draw_solutions(settings: SolutionSettings, source: str) -> list[Solution]:
    """Draw the solutions of a source's bodies; the same name gives the same draws."""
    return [OWN_WEIGHTS, *(_draw(settings, source, number) for number in range(1, settings.n))]


def _draw(settings: SolutionSettings, source: str, number: int) -> Solution:
    text = f"{settings.random_seed}\0{source}\0{number}".encode()
    seed = int.from_bytes(hashlib.blake2b(text, digest_size=8).digest())
    deviations = np.array([settings.yielding, settings.root, settings.limbs])
    factors = np.exp(deviations * np.random.default_rng(seed).standard_normal(3))
    return Solution(number, *factors.tolist())
