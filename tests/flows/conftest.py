"""One Prefect server for all tests of flows."""

import os
import signal

import pytest
from prefect.settings import PREFECT_API_URL
from prefect.testing.utilities import prefect_test_harness

from pacmo_core.project.processes import SIGNALS
from tests.project.conftest import pipeline

__all__ = ["pipeline"]


@pytest.fixture(scope="session")
def prefect_server():
    """Start one temporary Prefect server on loopback, with a data base of its own."""
    os.environ["DO_NOT_TRACK"] = "1"
    os.environ["PREFECT_SERVER_ANALYTICS_ENABLED"] = "false"
    with prefect_test_harness(server_startup_timeout=120), pytest.MonkeyPatch.context() as patch:
        # For the flows that tests start as processes.
        patch.setenv("PREFECT_API_URL", PREFECT_API_URL.value())
        yield


@pytest.fixture(autouse=True)
def _signal_handlers():
    """Restore the handlers: commands, which end after it, leave signals ignored."""
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)
