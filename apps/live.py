"""Frames in on standard input, answers out on standard output, one line each."""

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from pacmo_core.data.interaction import Motion
from pacmo_core.project.workspace import CommandError
from pacmo_core.reaction.stream import ReactionStream


def answered(lines: Iterable[str], live: ReactionStream, n_joints: int) -> Iterator[str]:
    """Answer each line in its own form: JSON, or numbers between blanks."""
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            time, pose, as_json = _frame(line, n_joints)
            reactions = live.react(pose, time)
        except (ValueError, KeyError, TypeError) as fault:
            raise CommandError(f"line {number}: {fault}") from fault
        yield _json(time, reactions) if as_json else _numbers(time, reactions)


def _frame(line: str, n_joints: int) -> tuple[float, Motion, bool]:
    as_json = line.lstrip().startswith("{")
    if as_json:
        facts: dict[str, Any] = json.loads(line)
        if set(facts) != {"time", "pose"}:
            raise ValueError(f"wanted the keys time and pose; got {sorted(facts)}")
        return float(facts["time"]), np.array(facts["pose"], np.float32), True
    values = np.array(line.replace(",", " ").split(), np.float64)
    if len(values) != 1 + 3 * n_joints:
        raise ValueError(f"wanted a time and {3 * n_joints} numbers; got {len(values)} in all")
    return float(values[0]), values[1:].astype(np.float32).reshape(-1, 3), False


def _json(time: float, reactions: Motion) -> str:
    return json.dumps({"time": time, "reactions": reactions.round(6).tolist()})


def _numbers(time: float, reactions: Motion) -> str:
    return " ".join([repr(time), *(f"{value:.6f}" for value in reactions.reshape(-1).tolist())])
