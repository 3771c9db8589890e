"""Truth: the real SBU files where they are at hand, and the rules by which addresses are built."""

import json
import os
import re
from pathlib import Path

import pytest

import pacmo_core.commands.fetch
from pacmo_core.commands.download import Checksums, shipped_checksums
from pacmo_core.commands.fetch import CMU, SBU

REAL_DATA = Path(__file__).parents[2] / "../shared/data"


def test_every_shipped_sum_is_a_sum_of_a_file_that_can_be_fetched() -> None:
    folders = {f"{s.folder}/{part}" for s in (SBU, CMU) for part in s.parts}
    for place, wanted in shipped_checksums().items():
        assert re.fullmatch(r"[0-9a-f]{64}", wanted)
        assert "/".join(place.split("/")[:2]) in folders
    known_pairs = {place.split("/")[1] for place in shipped_checksums() if place.startswith("sbu/")}
    assert known_pairs == set(SBU.parts)


def test_cmu_lists_both_people_of_every_trial() -> None:
    files = [file for part in CMU.parts for file in CMU.files(part)]
    assert len(files) == len(set(files)) == 10 + 2 * 70
    for a, b in zip(CMU.parts[::2], CMU.parts[1::2], strict=True):
        assert [f.replace(f"{a}/{a}", f"{b}/{b}") for f in CMU.files(a)] == CMU.files(b)


def test_the_real_skeletons_have_the_shipped_sums() -> None:
    root = Path(os.environ.get("PACMO_REAL_DATA", REAL_DATA))
    if not (root / "sbu").is_dir():
        pytest.skip(f"no real captures in {root}; PACMO_REAL_DATA may name another folder")
    sums = Checksums(root, shipped_checksums())
    places = [place for place in sums.places("sbu") if (root / place).exists()]
    assert len(places) == 282
    assert all(sums.verified(place) for place in places)


def test_shipped_sums_say_where_they_come_from() -> None:
    text = (Path(pacmo_core.commands.fetch.__file__).parent / "known_checksums.json").read_text()
    assert "public copy" in json.loads(text)["about"]
