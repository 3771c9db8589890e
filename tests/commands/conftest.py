"""Loopback servers that stop with the test."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import pacmo_core.commands.fetch
from pacmo_core.commands.download import PartialFile, RetryPolicy
from tests.commands.downloading import CONTENT
from tests.commands.fetching import GOOD_ZIP, PLACE_1, PLACE_2, TAKE_1, TAKE_2, know, sha256
from tests.commands.site import Site, serving


@pytest.fixture
def site() -> Iterator[Site]:
    with serving(Site(files={"/a.zip": CONTENT})) as site:
        yield site


@pytest.fixture
def part(tmp_path: Path) -> PartialFile:
    return PartialFile(tmp_path / "a.zip")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    """Serve pair s01s02 and subject 33 of known content; no other sum is known."""
    for name in ("http_proxy", "https_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)
    patience = RetryPolicy(attempts=2, first_wait=0.0, timeout=5.0)
    monkeypatch.setattr(pacmo_core.commands.fetch, "RETRY_POLICY", patience)
    know(monkeypatch, {PLACE_1: sha256(TAKE_1), PLACE_2: sha256(TAKE_2)})
    files = {"/s01s02.zip": GOOD_ZIP}
    files |= {f"/33/{name}": name.encode() for name in ("33.asf", "33_01.amc", "33_02.amc")}
    with serving(Site(files=files)) as server:
        yield server
