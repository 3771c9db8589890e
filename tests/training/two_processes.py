"""Run by torchrun: the gradients of both networks on this process's share of each batch.

Usage: python -m tests.training.two_processes OUT
"""

import sys
from pathlib import Path

import torch
import torch.distributed as dist

from pacmo_core.store.weights import write_weights
from tests.training.test_devices import gradients

if __name__ == "__main__":
    torch.set_num_threads(1)
    dist.init_process_group("gloo")
    found = gradients()
    write_weights(Path(sys.argv[1]) / f"{dist.get_rank()}.safetensors", {}, found)
    dist.destroy_process_group()
