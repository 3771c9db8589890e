"""Show a run: one live line on a terminal, or else a line an event and one after long silence."""

import json
import os
import select
import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TextIO

from flows.dvc_commands import progress_file

_REFRESH_S = 0.5
_SILENCE_S = 120  # without a terminal: after so long a line says what runs
_CLEAR_LINE = "\r\x1b[2K"
_INFO = "info"


@dataclass
class RunningStage:
    """A stage that runs, with the first progress that it reported.

    Parameters
    ----------
    name : its address
    started : seconds, by ``time.monotonic``
    first : time and number of units done at the first report
    """

    name: str
    started: float
    first: tuple[float, float] | None = None

    def text(self, now: float) -> str:
        """Return stage, units done and the time left, as far as they are known."""
        facts = _read_progress(self.name)
        done, total = facts.get("done"), facts.get("total")
        if not isinstance(done, int | float) or not isinstance(total, int | float) or not total:
            return f"{self.name} {duration(now - self.started)}"
        if self.first is None:
            self.first = now, done
        text = f"{self.name} {facts.get('unit', '')} {done:g} of {total:g}"
        first_time, first_done = self.first
        # By what was done since the first report: a resumed training does not start at zero.
        if done > first_done:
            left = (now - first_time) * (total - done) / (done - first_done)
            return f"{text}, {duration(left)} left"
        return text


@dataclass
class Display:
    """Events of a run as lines on a stream.

    Parameters
    ----------
    stream : where to
    live : whether the stream is a terminal
    clock : gives seconds
    """

    stream: TextIO = field(default_factory=lambda: sys.stderr)
    live: bool = field(default_factory=lambda: sys.stderr.isatty())
    clock: Callable[[], float] = time.monotonic
    written: float = 0.0
    running: dict[str, RunningStage] = field(default_factory=dict)
    n_ended: int = 0
    n_stages: int = 0
    last_error: str = ""

    def follow(self, descriptor: int) -> None:
        """Show the events that come through a pipe as JSON lines, until its other end closes."""
        rest = b""
        while True:
            if not select.select([descriptor], [], [], _REFRESH_S)[0]:
                self.refresh()
                continue
            data = os.read(descriptor, 65536)
            if not data:
                break
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                self.show(json.loads(line))
            self.refresh()
        self.clear()

    def show(self, event: dict[str, Any]) -> None:
        """Show one event of the log."""
        text = str(event["event"])
        if "n_stages" in event:
            self.n_stages, self.n_ended = event["n_stages"], 0
        state = event.get("state")
        if state == "start":
            self.running[event["stage"]] = RunningStage(event["stage"], self.clock())
        elif state == "end":
            self.running.pop(event["stage"], None)
            self.n_ended += 1
        if event.get("level") != _INFO:
            self.last_error = text
            text = f"pacmo: {text}"
        # On a terminal the live line shows what has started.
        if not (self.live and state == "start"):
            self.clear()
            self._write(f"{text}\n")

    def refresh(self) -> None:
        """Write the live line anew, or without a terminal a line after long silence."""
        now = self.clock()
        if not self.running or not (self.live or now - self.written >= _SILENCE_S):
            return
        stages = " | ".join(stage.text(now) for stage in self.running.values())
        line = f"[{self.n_ended} of {self.n_stages}] {stages}"
        if self.live:
            width = shutil.get_terminal_size().columns
            self._write(_CLEAR_LINE + line[: width - 1])
        else:
            self._write(f"{line}\n")

    def clear(self) -> None:
        """Remove the live line."""
        if self.live:
            self._write(_CLEAR_LINE)

    def _write(self, text: str) -> None:
        self.stream.write(text)
        self.stream.flush()
        self.written = self.clock()


def duration(seconds: float) -> str:
    """Return a duration in words: ``45 s``, ``3 min 20 s`` or ``2 h 5 min``."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def _read_progress(stage: str) -> dict[str, Any]:
    try:
        facts = json.loads(progress_file(stage).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return facts if isinstance(facts, dict) else {}
