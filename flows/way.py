"""How the steps of a flow are run: by hand, in this process, or as tasks that Prefect shows.

The steps are plain functions and know nothing of it. By hand needs no server; the other way is
what a flow uses, so that each step has its state, its time and its log on Prefect's page.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import ParamSpec, Protocol, TypeVar

from prefect import task
from prefect.cache_policies import NO_CACHE
from prefect.futures import PrefectFuture

Given = ParamSpec("Given")
Result = TypeVar("Result")
Stages = Mapping[str, Sequence[str]]  # by stage, in running order, what it rests on


class Way(Protocol):
    """A way to run steps."""

    def step(
        self, do: Callable[Given, Result], *args: Given.args, **kwargs: Given.kwargs
    ) -> Result:
        """Run one step and wait for it."""
        ...

    def stages(self, run: Callable[[str], None], order: Stages) -> None:
        """Run stages side by side, each after what it rests on; raise the first failure."""
        ...


class ByHand:
    """In this process, stages by threads."""

    def __init__(self, *, workers: int) -> None:
        self._workers = workers

    def step(
        self, do: Callable[Given, Result], *args: Given.args, **kwargs: Given.kwargs
    ) -> Result:
        """Call it."""
        return do(*args, **kwargs)

    def stages(self, run: Callable[[str], None], order: Stages) -> None:
        """Run stages in threads.

        They start in running order, so of those that have started, the first one waits for none.
        """
        done: dict[str, Future[None]] = {}

        def after(stage: str, upstream: list[Future[None]]) -> None:
            for before in upstream:
                before.result()
            run(stage)

        with ThreadPoolExecutor(self._workers) as pool:
            for stage, upstream in order.items():
                waits = [done[name] for name in upstream if name in done]
                done[stage] = pool.submit(after, stage, waits)
        for future in done.values():
            future.result()


class ByPrefect:
    """As Prefect's tasks, inside a flow whose task runner has threads."""

    def step(
        self, do: Callable[Given, Result], *args: Given.args, **kwargs: Given.kwargs
    ) -> Result:
        """Run it as a task."""
        shown = task(do, name=do.__name__, cache_policy=NO_CACHE, persist_result=False)
        result: Result = shown(*args, **kwargs)
        return result

    def stages(self, run: Callable[[str], None], order: Stages) -> None:
        """Run a task a stage, named after it."""
        runs: dict[str, PrefectFuture[None]] = {}
        for stage, upstream in order.items():
            one = task(run, name=stage, cache_policy=NO_CACHE, persist_result=False)
            runs[stage] = one.submit(
                stage, wait_for=[runs[name] for name in upstream if name in runs]
            )
        for future in runs.values():
            future.result()  # wait() alone would call a flow complete though every task failed
