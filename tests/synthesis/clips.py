"""Clips that the tests of this folder share: every action by a few pairs, before the camera."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pacmo_core.data.skeleton import NTU25
from pacmo_core.synthesis.capture import noiseless_motion
from pacmo_core.synthesis.script import ACTIONS, Script, sample_scripts

POPULATION = 7
JOINT = {name: index for index, name in enumerate(NTU25.joints)}


@dataclass(frozen=True)
class Clip:
    """A script and both true motions."""

    script: Script
    motions: tuple[NDArray[np.float64], NDArray[np.float64]]

    @property
    def times(self) -> NDArray[np.float64]:
        """Give the frame_times of the frames."""
        return np.array(self.script.frame_times)

    @property
    def initiator(self) -> int:
        """Say who actions, 0 or 1."""
        return "ab".index(self.script.initiator)

    def hand(self, person: int) -> str:
        """Say which hand a person uses."""
        return ("left", "right")[self.script.hands[person]]

    def at(self, person: int, joint: str, time: float) -> NDArray[np.float64]:
        """Give a joint's place at the frame nearest a time."""
        frame = int(np.abs(self.times - time).argmin())
        place: NDArray[np.float64] = self.motions[person][frame, JOINT[joint]]
        return place


@lru_cache(maxsize=64)
def clips(action: str) -> tuple[Clip, ...]:
    shoot = sample_scripts(11, population=POPULATION, pairs=6, actions=(action,), replications=2)
    found = []
    for script, random in shoot:
        a, b = random.spawn(2)
        found.append(
            Clip(script, (noiseless_motion(script, a, "a"), noiseless_motion(script, b, "b")))
        )
    return tuple(found)


def every_motion() -> list[tuple[Clip, NDArray[np.float64]]]:
    return [
        (clip, motion) for action in ACTIONS for clip in clips(action) for motion in clip.motions
    ]


def distance_to_segment(
    point: NDArray[np.float64], start: NDArray[np.float64], stop: NDArray[np.float64]
) -> float:
    along = stop - start
    share = np.clip((point - start) @ along / (along @ along), 0.0, 1.0)
    return float(np.linalg.norm(point - start - share * along))
