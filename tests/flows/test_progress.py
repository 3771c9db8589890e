"""What a run shows while it runs."""

import io
import json
from pathlib import Path
from typing import Any

import pytest

from flows.dvc_commands import progress_file
from flows.progress import Display

STAGE = "train_reaction@gru-1-1"


class Clock:
    now = 1000.0

    def __call__(self) -> float:
        """Return the time that the test says."""
        return self.now


def started(clock: Clock, *, live: bool) -> Display:
    display = Display(io.StringIO(), live=live, clock=clock)
    for event in (
        {"event": "2 of 5 stages are stale", "level": "info", "n_stages": 2},
        {"event": f"start {STAGE}", "level": "info", "stage": STAGE, "state": "start"},
    ):
        display.show(event)
    return display


def report(**facts: Any) -> None:
    file = progress_file(STAGE)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(facts))


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def lines(display: Display) -> list[str]:
    assert isinstance(display.stream, io.StringIO)
    return display.stream.getvalue().splitlines()


def test_without_a_terminal_a_line_says_what_runs_after_two_silent_minutes() -> None:
    clock = Clock()
    display = started(clock, live=False)
    said = lines(display)
    assert said == ["2 of 5 stages are stale", f"start {STAGE}"]
    report(done=2, total=26, unit="epochs")
    clock.now += 119
    display.refresh()
    assert lines(display) == said
    clock.now += 1
    display.refresh()
    assert lines(display)[2:] == [f"[0 of 2] {STAGE} epochs 2 of 26"]
    report(done=8, total=26, unit="epochs")
    clock.now += 120
    display.refresh()
    assert lines(display)[3:] == [f"[0 of 2] {STAGE} epochs 8 of 26, 6 min 0 s left"]


def test_an_event_breaks_the_silence_and_nothing_is_said_of_nothing() -> None:
    clock = Clock()
    display = started(clock, live=False)
    clock.now += 100
    end = {"event": f"done {STAGE}", "level": "info", "stage": STAGE, "state": "end"}
    display.show({"event": "another", "level": "info"})
    clock.now += 100
    display.refresh()
    assert len(lines(display)) == 3
    display.show(end)
    clock.now += 1000
    display.refresh()
    assert lines(display)[3:] == [f"done {STAGE}"]


def test_a_terminal_has_one_line_that_is_written_anew() -> None:
    clock = Clock()
    display = started(clock, live=True)
    report(done=2, total=26, unit="epochs")
    display.refresh()
    display.refresh()
    assert isinstance(display.stream, io.StringIO)
    text = display.stream.getvalue()
    assert text.count(f"[0 of 2] {STAGE} epochs 2 of 26") == 2
    assert text.count("\n") == 1
