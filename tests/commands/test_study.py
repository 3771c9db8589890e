"""Truth: the rules of balance and blindness counted out; the answers that were sent."""

import asyncio
import json
from pathlib import Path

import httpx
import numpy as np
import pytest
from fastapi import FastAPI
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.commands.study_clips import balanced_sample
from pacmo_core.commands.study_limits import RateLimiter
from pacmo_core.commands.study_server import StudySettings, create_app
from pacmo_core.commands.study_store import GENERATED, REAL, Candidate, Study
from pacmo_core.data.skeleton import SBU15
from pacmo_core.store.motions import write_motions
from tests.commands.studies import small_study
from tests.figures.samples import interaction

PER_PERSON = 14


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return small_study(tmp_path / "s.sqlite")


class Page:
    """Asks a server in this process, one question after another."""

    def __init__(self, served: FastAPI) -> None:
        self.served = served

    def get(self, path: str) -> httpx.Response:
        """Ask for a page."""
        return asyncio.run(self._ask("GET", path))

    def post(self, path: str, **content: object) -> httpx.Response:
        """Send something."""
        return asyncio.run(self._ask("POST", path, **content))

    async def _ask(self, method: str, path: str, **content: object) -> httpx.Response:
        transport = httpx.ASGITransport(self.served)
        async with httpx.AsyncClient(transport=transport, base_url="http://study") as web:
            return await web.request(method, path, **content)


def client(study: Path, rate: float = 1e6, burst: float = 1e6, people: int = 9) -> Page:
    settings = StudySettings(PER_PERSON, people, per_address=people)
    return Page(create_app(Study(study), settings, RateLimiter(rate, burst)))


def test_draws_are_balanced_blind_to_order_and_never_show_a_source_twice() -> None:
    random = np.random.default_rng(0)
    kinds = {2 * k + j: kind for k in range(20) for j, kind in enumerate((REAL, GENERATED))}
    shown = dict.fromkeys(kinds, 0)
    first = {REAL: 0, GENERATED: 0}
    for _ in range(200):
        seen = [Candidate(i, kinds[i], f"s{i // 2}", shown[i]) for i in kinds]
        chosen = balanced_sample(seen, PER_PERSON, random)
        assert sum(kinds[i] == REAL for i in chosen) == 7
        assert len({i // 2 for i in chosen}) == len(chosen) == PER_PERSON
        first[kinds[chosen[0]]] += 1
        for i in chosen:
            shown[i] += 1
    assert max(shown.values()) - min(shown.values()) <= 8  # of 70 each
    assert min(first.values()) > 70


def test_too_few_sources_are_refused() -> None:
    seen = [Candidate(k, (REAL, GENERATED)[k % 2], f"s{k // 2}", 0) for k in range(10)]
    with pytest.raises(ValueError, match="6 sources"):
        balanced_sample(seen, 6, np.random.default_rng(0))


def test_a_participant_answers_goes_on_and_is_counted_once(study: Path) -> None:
    page = client(study)
    begun = page.post("/begin", json={"consent": True}).json()
    person = begun["person"]
    assert begun["count"] == PER_PERSON
    for place in range(PER_PERSON):
        scene = page.get(f"/clip/{person}/{place}").json()
        assert "s1" not in json.dumps(scene[0]["label"])
        for real in (True, False, True):  # sent again, and otherwise
            said = page.post("/answer", json={"person": person, "place": place, "real": real})
            assert said.json() == {"kept": True}
    again = client(study).get(f"/progress/{person}").json()
    assert again == {"count": PER_PERSON, "answered": list(range(PER_PERSON))}
    assert [answer.real for answer in Study(study).answers()] == [True] * PER_PERSON


@pytest.mark.parametrize(
    "content",
    [
        {}, {"person": "x" * 22, "place": 0}, {"person": "x", "place": 0, "real": True},
        {"person": "x" * 22, "place": -1, "real": True},
        {"person": "x" * 22, "place": "0", "real": True},
        {"person": "x" * 22, "place": 0, "real": "yes"},
        {"person": "x" * 22, "place": 0, "real": 1},
        {"person": "x" * 22, "place": 0, "real": True, "more": 1}, [], "text", None,
    ],
)  # fmt: skip
def test_malformed_answers_are_refused_without_an_echo(study: Path, content: object) -> None:
    said = client(study).post("/answer", json=content)
    assert said.status_code == 422
    assert said.json() == {"error": "malformed request"}


def test_unknown_people_and_places_and_pages_are_not_found(study: Path, tmp_path: Path) -> None:
    page = client(study)
    nobody = "x" * 22
    for path in (f"/progress/{nobody}", f"/clip/{nobody}/0", "/docs", "/openapi.json", "/../../x"):
        said = page.get(path)
        assert said.status_code == 404
        assert str(tmp_path) not in said.text
    said = page.post("/answer", json={"person": nobody, "place": 0, "real": True})
    assert said.status_code == 404
    assert page.post("/begin", json={"consent": False}).status_code == 422


def test_large_and_hasty_questions_are_refused(study: Path) -> None:
    page = client(study, rate=0.001, burst=3)
    assert page.post("/answer", content=b"x" * 2000).status_code == 413
    codes = [page.get("/").status_code for _ in range(5)]
    assert codes == [200, 200, 200, 429, 429]


def test_a_study_that_has_its_people_turns_others_away(study: Path) -> None:
    page = client(study, people=1)
    assert page.post("/begin", json={"consent": True}).status_code == 200
    assert client(study, people=1).post("/begin", json={"consent": True}).status_code == 410


def test_every_answer_bears_the_policy_and_the_page_says_the_same(study: Path) -> None:
    page = client(study)
    for path in ("/", "/nowhere"):
        headers = page.get(path).headers
        assert headers["content-security-policy"].startswith("default-src 'none'")
        assert headers["x-content-type-options"] == "nosniff"
    assert "unsafe-eval" not in page.get("/").headers["content-security-policy"]


def test_make_draws_clips_that_tell_nothing_of_what_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder, tail in (("data/clips", ""), ("answers", "#a#0")):
        with write_motions(tmp_path / folder / "motions.parquet", SBU15) as writer:
            for k in range(4):
                writer.add(f"clip{k}{tail}", interaction(k))
    words = ["study", "make", "s.sqlite", "--reactions", "answers", "--count"]
    assert CliRunner().invoke(app, [*words, "3"]).exit_code == 0
    study = Study(tmp_path / "s.sqlite")
    seen = study.candidates()
    assert [c.kind for c in seen] == [REAL, GENERATED] * 3
    study.begin("ann", lambda seen: [c.item for c in seen], 1)
    for place in range(6):
        scene = study.scene("ann", place)
        assert scene
        assert not any(word in scene for word in ("clip", "answers", "#a", "captured", "generated"))
    refused = CliRunner().invoke(app, [*words, "3"])
    assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1)
    refused = CliRunner().invoke(app, [*words[:2], "t.sqlite", *words[3:], "9"])
    assert "got 4" in refused.stderr
