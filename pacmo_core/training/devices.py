"""Where a training runs: threads, device, memory, and the processes that torchrun starts."""

import ctypes
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import torch
import torch.distributed as dist
from torch import Tensor


class DeviceError(ValueError):
    """A device that is not at hand, or processes where one is wanted."""


@contextmanager
def training_device(device: str, *, threads: int, multiprocess: bool) -> Iterator[str]:
    """Name the device to train on, its process group open while the block runs.

    Parameters
    ----------
    device : cpu, cuda, or auto: cuda where there is one
    threads : of torch; another number rounds otherwise
    multiprocess : whether the training can share its batches between torchrun's processes

    Raises
    ------
    DeviceError
        If cuda is wanted and not there, or torchrun started more processes than can share.
    """
    found = _resolve_device(device)
    torch.set_num_threads(threads)
    # Exact on the CPU; on a GPU some of what the networks do has no exact form.
    torch.use_deterministic_algorithms(mode=found == "cpu")
    n_processes = int(os.environ.get("WORLD_SIZE", "1"))
    if n_processes == 1:
        yield found
        return
    if not multiprocess:
        raise DeviceError(f"this training runs in one process; torchrun started {n_processes}")
    if found == "cuda":
        found = f"cuda:{os.environ['LOCAL_RANK']}"
        torch.cuda.set_device(found)
    dist.init_process_group("gloo" if found == "cpu" else "nccl")
    try:
        yield found
    finally:
        dist.destroy_process_group()


def is_main_process() -> bool:
    """Say whether this process writes: the first of a group, or one alone."""
    return not dist.is_initialized() or dist.get_rank() == 0


def _resolve_device(device: str) -> str:
    if device not in ("auto", "cpu", "cuda"):
        raise DeviceError(f"device must be auto, cpu or cuda; got {device}")
    there = torch.cuda.is_available()
    if device == "cuda" and not there:
        raise DeviceError("device is cuda, and torch finds none; take auto or cpu")
    return "cuda" if there and device != "cpu" else "cpu"


@dataclass(frozen=True)
class ProcessGroup:
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
    def of_group(cls) -> "ProcessGroup":
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


# The C library's numbers for what it is told (glibc, malloc.h).
_TRIM_THRESHOLD, _MMAP_MAX = -1, -4


def keep_freed_memory() -> None:
    """Keep what is freed for what is asked for next, until the process ends.

    glibc gives large pieces back to the system at once, and a training step asks for as many as the
    last one freed: to fetch them anew, a page at a time, is an eighth of a step of the skeleton
    prior. Other C libraries have no such setting and are left as they are.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(_MMAP_MAX, 0)
        library.mallopt(_TRIM_THRESHOLD, 2**31 - 1)
