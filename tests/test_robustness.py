"""Truth: readers that crash, hang, take memory or accept anything, made for the test."""

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import robustness
from benchmarks._crafted import crafted_cases
from benchmarks._fuzz_binary import make_templates
from benchmarks._fuzz_cases import check_message, run_case, targets
from benchmarks._fuzz_study import serving_study
from benchmarks.robustness import Job, Tally, supervise
from pacmo_core.formats.base import FormatError
from pacmo_core.formats.registry import FORMATS


@pytest.fixture(scope="module")
def templates(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("templates")
    make_templates(folder)
    with serving_study(folder):
        yield folder


def _crash(*_: Path) -> None:
    raise LookupError


def _grow(*_: Path) -> None:
    np.ones(3 * 10**7)


def _hang(*_: Path) -> None:
    while True:
        time.process_time()


def _wait(*_: Path) -> None:
    threading.Event().wait()


def _exit(*_: Path) -> None:
    os._exit(1)


def _refuse(*_: Path) -> None:
    raise FormatError(Path("x"), "no")


@pytest.mark.parametrize(
    ("run", "outcome"),
    [
        (_crash, "crashed"),
        (_exit, "crashed"),
        (_grow, "over_memory"),
        (_hang, "hung"),
        (_wait, "hung"),
        (_refuse, "refused"),
        (lambda *_: None, "wrongly_accepted"),
    ],
)
def test_each_fault_of_a_reader_is_counted_and_the_next_case_runs(
    monkeypatch: pytest.MonkeyPatch, run: object, outcome: str
) -> None:
    case = SimpleNamespace(run=run, documented=(FormatError,))
    good = SimpleNamespace(run=_refuse, documented=(FormatError,))
    monkeypatch.setattr(robustness, "crafted_cases", lambda: {"bad": case, "good": good})
    monkeypatch.setattr(robustness, "LIMIT_S", 1)
    monkeypatch.setattr(robustness, "WAIT_S", 1 if run is _wait else 60)
    if outcome == "over_memory":
        monkeypatch.setattr(robustness, "MAX_GROWTH_KB", 1)
    tally = Tally()
    supervise(Job(Path(), ("bad", "good"), None), 2, tally)
    assert tally.outcomes.total() == 2
    assert tally.outcomes[outcome] >= 1


def test_every_crafted_file_is_refused(templates: Path, tmp_path: Path) -> None:
    for number, (name, case) in enumerate(crafted_cases().items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        with pytest.raises(case.documented) as caught:
            case.run(folder, templates)
            pytest.fail(f"{name} was accepted")
        check_message(caught.value)


@pytest.mark.filterwarnings("ignore")
def test_every_reader_accepts_some_random_files_and_refuses_others(
    templates: Path, tmp_path: Path
) -> None:
    outcomes = dict[str, set[bool]]()
    for name, target in targets(templates).items():
        for case in range(30):
            folder = tmp_path / f"{name}{case}"
            folder.mkdir()
            outcomes.setdefault(name, set()).add(run_case(target, (1, case), folder))
    assert {name for name, found in outcomes.items() if found != {True, False}} == set()
    assert {"inbox", "study"} <= set(outcomes)
    read = {*outcomes, "interhuman"} if "npy" in outcomes else set(outcomes)
    assert set(FORMATS) <= read
