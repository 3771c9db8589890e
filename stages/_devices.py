"""Where a training runs: threads, device, and the processes that torchrun started."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

import torch
import torch.distributed as dist


class DeviceError(ValueError):
    """A device that is not at hand, or processes where one is wanted."""


@contextmanager
def devices(device: str, *, threads: int, shares: bool) -> Iterator[str]:
    """Name the device to train on, its process group open while the block runs.

    Parameters
    ----------
    device : cpu, cuda, or auto: cuda where there is one
    threads : of torch; another number rounds otherwise
    shares : whether the training can share its batches between torchrun's processes

    Raises
    ------
    DeviceError
        If cuda is wanted and not there, or torchrun started more processes than can share.
    """
    found = _resolve(device)
    torch.set_num_threads(threads)
    # Exact on the CPU; on a GPU some of what the networks do has no exact form.
    torch.use_deterministic_algorithms(mode=found == "cpu")
    n_processes = int(os.environ.get("WORLD_SIZE", "1"))
    if n_processes == 1:
        yield found
        return
    if not shares:
        raise DeviceError(f"this training runs in one process; torchrun started {n_processes}")
    if found == "cuda":
        found = f"cuda:{os.environ['LOCAL_RANK']}"
        torch.cuda.set_device(found)
    dist.init_process_group("gloo" if found == "cpu" else "nccl")
    try:
        yield found
    finally:
        dist.destroy_process_group()


def leads() -> bool:
    """Say whether this process writes: the first of a group, or one alone."""
    return not dist.is_initialized() or dist.get_rank() == 0


def _resolve(device: str) -> str:
    if device not in ("auto", "cpu", "cuda"):
        raise DeviceError(f"device must be auto, cpu or cuda; got {device}")
    there = torch.cuda.is_available()
    if device == "cuda" and not there:
        raise DeviceError("device is cuda, and torch finds none; take auto or cpu")
    return "cuda" if there and device != "cpu" else "cpu"
