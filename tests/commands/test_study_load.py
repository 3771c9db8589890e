"""Truth: the answers that were acknowledged, kept beside by those who sent them."""

import asyncio
import signal
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from pacmo_core.commands.study_store import Study
from tests.commands.studies import free_port, served, small_study
from tests.waiting import wait_until

PER_PERSON = 14
Kept = dict[tuple[str, int], bool]
pytestmark = pytest.mark.slow


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return small_study(tmp_path / "s.sqlite")


async def insist(web: httpx.AsyncClient, path: str, content: object) -> httpx.Response:
    """Send again until there is an answer, as the page does."""
    while True:
        try:
            return await web.post(path, json=content)
        except httpx.TransportError:
            await asyncio.sleep(1)


async def participate(web: httpx.AsyncClient, number: int, kept: Kept) -> None:
    """Answer every clip, some twice, and the second time otherwise."""
    begun = (await insist(web, "/begin", {"consent": True})).json()
    assert begun["count"] == PER_PERSON
    for place in range(PER_PERSON):
        real = (number + place) % 3 > 0
        for said in (real, not real)[: 2 - place % 2]:  # the last one once
            content = {"person": begun["person"], "place": place, "real": said}
            assert (await insist(web, "/answer", content)).json() == {"kept": True}
            kept.setdefault((begun["person"], place), said)


async def answer_all(
    address: str, people: int, kept: Kept, meanwhile: Callable[[], object] = int
) -> None:
    """Let people answer side by side, and something happen to the server meanwhile."""
    limits = httpx.Limits(max_connections=people)
    async with httpx.AsyncClient(base_url=address, timeout=120, limits=limits) as web:
        everybody = [participate(web, number, kept) for number in range(people)]
        await asyncio.gather(asyncio.to_thread(meanwhile), *everybody)


def held(study: Path) -> Kept:
    """Read what the study holds; by its own rules no place has two answers."""
    opened = Study(study)
    found = {(a.person, a.place): a.real for a in opened.answers()}
    assert len(found) == len(opened.answers())
    opened.close()
    return found


def test_of_two_hundred_participants_at_once_no_answer_is_lost_or_doubled(study: Path) -> None:
    kept: Kept = {}
    with served(study) as (address, _):
        asyncio.run(answer_all(address, 200, kept))
    assert len(kept) == 200 * PER_PERSON
    assert held(study) == kept


@pytest.mark.parametrize("people", [30, pytest.param(300, marks=pytest.mark.scheduled)])
def test_kills_in_the_middle_lose_nothing_that_was_acknowledged(study: Path, people: int) -> None:
    kept: Kept = {}
    port = free_port()
    met: list[int] = []

    def serve_until(share: float) -> None:
        with served(study, port) as (_, process):
            wait_until(lambda: len(kept) >= share * people * PER_PERSON)
            process.send_signal(signal.SIGKILL)
            process.wait()
        # Nobody writes now: what was acknowledged so far must stand already.
        acknowledged, found = dict(kept), held(study)
        assert acknowledged.items() <= found.items()
        met.append(len(found))

    def kill_again_and_again() -> None:
        for share in (0.3, 0.6, 1.0):
            serve_until(share)

    asyncio.run(answer_all(f"http://127.0.0.1:{port}", people, kept, kill_again_and_again))
    assert 0 < met[0] < met[1] < people * PER_PERSON
    assert len(kept) == people * PER_PERSON
    assert held(study) == kept
