"""Several processes that train one network, as `torchrun` starts them; one process alone needs none of it."""

import os
from datetime import timedelta

import torch

from swardmap.errors import ConfigError

PATIENCE = timedelta(hours=6)
"""For which processes wait for the first, while it validates or asks the teachers."""


def _check_device(device: str) -> None:
    try:
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:  # torch built without CUDA asserts
        reason = str(error).splitlines()[0]
        raise ConfigError(f"device '{device}': torch {torch.__version__} cannot use it ({reason})") from error


def join_processes(device: str) -> tuple[int, int]:
    """Rank and number of the processes that `torchrun` started; (0, 1) without it.

    Each process takes a GPU of its own where they run on GPUs.

    Raises:
        ConfigError: if torch cannot run on the device.
    """
    _check_device(device)
    world = int(os.environ.get("WORLD_SIZE", "1"))
    if world == 1:
        return 0, 1
    on_gpu = torch.device(device).type == "cuda"
    if on_gpu:
        torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
    if not torch.distributed.is_initialized():
        backend = "nccl" if on_gpu else "gloo"
        torch.distributed.init_process_group(backend, timeout=PATIENCE)
    return torch.distributed.get_rank(), world


def all_reduce_gradients(optimizer: torch.optim.Optimizer, world: int) -> None:
    """Every process steps along the mean of all gradients, so that their weights stay the same."""
    if world == 1:
        return
    for group in optimizer.param_groups:
        for parameter in group["params"]:
            if parameter.grad is None:  # a collective needs every process
                parameter.grad = torch.zeros_like(parameter)
            torch.distributed.all_reduce(parameter.grad)
            parameter.grad /= world
