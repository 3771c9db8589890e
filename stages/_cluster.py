"""Which cluster per-clip work goes to."""

import os

SCHEDULER = "DASK_SCHEDULER_ADDRESS"


def scheduler_address() -> str:
    """Give the address that the environment names; empty means this machine's processes."""
    return os.environ.get(SCHEDULER, "")
