"""Bodies between those of the data: to first order, what two changes of a body do adds up.

Variations show bones one at a time or all alike; bodies that are drawn mix them all. The solver's
answer to small changes is nearly linear in them, so a weighted sum of the changes that variations
of one source show stands for the variation of the body that they add up to.
"""

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Blend:
    """How often rows are blended, and of how many.

    Parameters
    ----------
    share : of the rows of a batch that are blends; 0, none
    most : other variations in one
    """

    share: float
    most: int

    def __post_init__(self) -> None:
        if not (0 <= self.share <= 1 and self.most >= 1):
            raise ValueError(
                f"share must lie in [0, 1] and most be at least 1; got {self.share}, {self.most}"
            )

    def draw(self, row: int, sources: Tensor, random: torch.Generator) -> tuple[Tensor, Tensor]:
        """Draw which variations are added up for a row, and with what weights, each in (0, 1).

        Parameters
        ----------
        sources : (N,) which template a variation varies

        Returns
        -------
        (M,) int64 and (M,) float32; of a row that stays as it is, itself and 1
        """
        if self.share <= float(torch.rand((), generator=random)):
            return torch.tensor([row]), torch.ones(1)
        alike = torch.nonzero(sources == sources[row])[:, 0]
        n_others = int(torch.randint(1, self.most + 1, (), generator=random))
        others = alike[torch.randint(len(alike), (n_others,), generator=random)]
        chosen = torch.cat([torch.tensor([row]), others])
        return chosen, torch.rand(len(chosen), generator=random)


def blended(
    template: Tensor, varied: Tensor, scales: Tensor, weights: Tensor
) -> tuple[Tensor, Tensor]:
    """Add up changes of motion and of bodies; no bone departs further from 1 than its parts show.

    Parameters
    ----------
    template : (..., J, 3)
    varied : (M, ..., J, 3)
    scales : (M, 2, J)
    weights : (M,)

    Returns
    -------
    the blend's motion (..., J, 3) and its scales (2, J)
    """
    departures = scales - 1
    change = torch.tensordot(weights, departures, dims=1)
    furthest = change.abs().max()
    within = 1.0 if furthest == 0 else float((departures.abs().max() / furthest).clamp(max=1))
    motion = template + within * torch.tensordot(weights, varied - template, dims=1)
    return motion, 1 + within * change
