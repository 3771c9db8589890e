"""Linear algebra on one thread: another number of threads rounds otherwise.

The solver's matrices are small, and its callers have as many processes as cores.
"""

from contextlib import AbstractContextManager

import scipy.linalg  # noqa: F401  # brings its BLAS, which the controller must find
from threadpoolctl import ThreadpoolController

_CONTROLLER = ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """Hold BLAS to one thread meanwhile."""
    limits: AbstractContextManager[object] = _CONTROLLER.limit(limits=1, user_api="blas")
    return limits
