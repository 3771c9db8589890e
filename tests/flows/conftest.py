"""One Prefect server for all tests of flows."""

import os

import pytest
from prefect.settings import PREFECT_API_URL
from prefect.testing.utilities import prefect_test_harness

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
