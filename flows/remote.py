"""DVC's remote, where one is set: the only steps that touch a network, and so are tried again."""

import time

from dvc.repo import Repo

from flows.run_dvc import StageError, run_dvc
from pacmo_core.project.workspace import log_event

ATTEMPTS, FIRST_WAIT_S = 3, 5.0


def has_remote() -> bool:
    """Tell whether DVC has a remote to push to."""
    with Repo() as repo:
        return bool(repo.config["core"].get("remote"))


def push(limit_s: float) -> bool:
    """Push what the cache holds of the workspace; three attempts, then it is the night's failure.

    Returns
    -------
    whether there is a remote
    """
    if not has_remote():
        return False
    for attempt in range(1, ATTEMPTS + 1):
        try:
            run_dvc("push", ["push", "--run-cache"], limit_s)
        except StageError as fault:
            if attempt == ATTEMPTS:
                raise
            log_event("push failed; it is tried again", attempt=attempt, reason=str(fault))
            time.sleep(FIRST_WAIT_S * 3 ** (attempt - 1))
        else:
            return True
    return True
