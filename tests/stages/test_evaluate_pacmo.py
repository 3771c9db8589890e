"""Truth: what the controller of threads says while rows are measured."""

import argparse

import pytest
import threadpoolctl

from stages import evaluate_pacmo


def test_rows_are_measured_on_one_thread_whatever_the_machine_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen = []

    def look(*_: object) -> None:
        blas = [pool for pool in threadpoolctl.threadpool_info() if pool["user_api"] == "blas"]
        seen.extend(pool["num_threads"] for pool in blas)

    monkeypatch.setattr(evaluate_pacmo, "evaluate", look)
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        evaluate_pacmo.main(argparse.Namespace())
    assert seen
    assert set(seen) == {1}
