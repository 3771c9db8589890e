"""The processes that share every batch between them; one alone is the usual case."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.distributed as dist
from torch import Tensor


@dataclass(frozen=True)
class Processes:
    """One process among those of its group.

    All draw the same batch from equal generators, and each keeps its own rows of it. torch's
    DistributedDataParallel can't serve here: it averages in hooks on ``backward``, which
    ``autograd.grad`` passes by, and it does not support the second derivative that the gradient
    penalty takes through the critic.

    Parameters
    ----------
    rank : of the one, from 0
    size : how many there are
    """

    rank: int
    size: int

    @classmethod
    def of_group(cls) -> "Processes":
        """Take the default process group, or this process alone where there is none."""
        if not dist.is_initialized():
            return cls(0, 1)
        return cls(dist.get_rank(), dist.get_world_size())

    def rows(self, n: int) -> slice:
        """Say which of n rows are this process's; shares differ by one at most.

        Raises
        ------
        ValueError
            If there are fewer rows than processes.
        """
        if n < self.size:
            raise ValueError(f"a batch wants a row a process, {self.size}; got {n}")
        return slice(n * self.rank // self.size, n * (self.rank + 1) // self.size)

    def mean(self, values: Sequence[Tensor], n: int) -> list[Tensor]:
        """Average over all n rows what each process has averaged over its own."""
        if self.size == 1:
            return list(values)
        mine = self.rows(n)
        flat = torch.cat([value.detach().flatten() for value in values])
        flat *= (mine.stop - mine.start) / n
        dist.all_reduce(flat)
        parts = torch.split(flat, [value.numel() for value in values])
        return [part.view_as(value) for part, value in zip(parts, values, strict=True)]
