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
    """A device that is not available, or several processes for a training of one."""


@contextmanager
def training_device(device: str, *, threads: int, multiprocess: bool) -> Iterator[str]:
    """Configure torch and yield the device to train on, inside torchrun's process group if any.

    Parameters
    ----------
    device : cpu, cuda, or auto: cuda where available
    threads : of torch; the number changes rounding
    multiprocess : whether the training can divide its batches among torchrun's processes

    Raises
    ------
    DeviceError
        If cuda is wanted and not available, or torchrun started several processes and the training
        runs in one.
    """
    resolved = resolve_device(device)
    torch.set_num_threads(threads)
    # On a GPU some operations of the networks have no deterministic implementation.
    torch.use_deterministic_algorithms(mode=resolved == "cpu")
    n_processes = int(os.environ.get("WORLD_SIZE", "1"))
    if n_processes == 1:
        yield resolved
        return
    if not multiprocess:
        raise DeviceError(f"this training runs in one process; torchrun started {n_processes}")
    if resolved == "cuda":
        resolved = f"cuda:{os.environ['LOCAL_RANK']}"
        torch.cuda.set_device(resolved)
    dist.init_process_group("gloo" if resolved == "cpu" else "nccl")
    try:
        yield resolved
    finally:
        dist.destroy_process_group()


def is_main_process() -> bool:
    """Whether this process writes files: the first of its group, or the only one."""
    return not dist.is_initialized() or dist.get_rank() == 0


def resolve_device(device: str) -> str:
    """Return ``cpu`` or ``cuda`` for ``cpu``, ``cuda`` or ``auto``.

    Raises
    ------
    DeviceError
        If there is no such device.
    """
    if device not in ("auto", "cpu", "cuda"):
        raise DeviceError(f"device must be auto, cpu or cuda; got {device!r}")
    available = torch.cuda.is_available()
    if device == "cuda" and not available:
        raise DeviceError("device is cuda, but torch finds none; use auto or cpu")
    return "cuda" if available and device != "cpu" else "cpu"


@dataclass(frozen=True)
class ProcessGroup:
    """Data-parallel training on several processes, seen from one of them.

    All processes sample the same batch from equal random generators, and each computes its rows.
    torch's DistributedDataParallel does not apply: it averages in hooks on ``backward``, which
    ``autograd.grad`` does not call, and it does not support the second derivative of the critic
    that the gradient penalty needs.

    Parameters
    ----------
    rank : of this process, from 0
    size : number of processes
    """

    rank: int
    size: int

    @classmethod
    def current(cls) -> "ProcessGroup":
        """Return the default process group; without one, a group of this process alone."""
        if not dist.is_initialized():
            return cls(0, 1)
        return cls(dist.get_rank(), dist.get_world_size())

    def rows(self, n: int) -> slice:
        """Return this process's slice of n rows; slices differ in size by at most one.

        Raises
        ------
        ValueError
            If there are fewer rows than processes.
        """
        if n < self.size:
            raise ValueError(f"a batch must have at least a row a process, {self.size}; got {n}")
        return slice(n * self.rank // self.size, n * (self.rank + 1) // self.size)

    def mean(self, values: Sequence[Tensor], n: int) -> list[Tensor]:
        """All-reduce to the mean over n rows what each process has averaged over its rows."""
        if self.size == 1:
            return list(values)
        local = self.rows(n)
        flat = torch.cat([value.detach().flatten() for value in values])
        flat *= (local.stop - local.start) / n
        dist.all_reduce(flat)
        parts = torch.split(flat, [value.numel() for value in values])
        return [part.view_as(value) for part, value in zip(parts, values, strict=True)]


# Parameters of mallopt (glibc, malloc.h).
_TRIM_THRESHOLD, _MMAP_MAX = -1, -4


def keep_freed_memory() -> None:
    """Let glibc's malloc reuse freed memory instead of returning it to the system.

    glibc returns large blocks at once, and each training step allocates as much as the last one
    freed: the page faults cost an eighth of a training step of a skeleton prior. Without effect
    with other C libraries.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(_MMAP_MAX, 0)
        library.mallopt(_TRIM_THRESHOLD, 2**31 - 1)
