"""Whether generated receivers of recorded handovers take the object.

Usage: python -m benchmarks.handover [REACTIONS.parquet ...] [--json]

Reactions are of the experiment ``handover``, by default those of PaCMO and the regression in
``data/reactions/1``; those to the giver count. Under PACMO_REAL_DATA the captures state where the
object is, of which a model is told while it is held. The transfer is the instant at which both
captured people have a wrist or hand nearest to it. Of each file, and of the captured receivers:

- at the captured transfer: ``hand_m`` the distance of the nearest wrist or hand to the object,
  median; ``within_10_cm`` and ``within_15_cm`` the shares of reactions in which it is so near, or
  is within 0.25 s of it; ``root_m`` the error of the pelvis over the floor, median;
- at their own, as who is generated may take the object earlier: at any time until 0.25 s after the
  captured transfer, ``own_m`` the least distance, median, and ``own_within_10_cm`` and
  ``own_within_15_cm`` the shares so near; ``in_time`` the share whose distance is least within
  0.25 s of the captured transfer.

``guess_in_time`` and ``ridge_in_time`` say how far the giver tells when the transfer is: the shares
of tested captures in which it is within 0.25 s of a guess, its median time before the end of the
training captures, and of a ridge regression on the giver's last four seconds.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks._captures import real_data
from benchmarks._figures import arguments, show
from pacmo_core.data.interaction import Motion
from pacmo_core.formats.base import to_y_up
from pacmo_core.store.motions import stream_motions

Array = NDArray[np.float64]

REACTIONS = Path("data/reactions/1")
DEFAULT = [REACTIONS / row / "1/motions.parquet" for row in ("pacmo", "regression")]
HANDS = ("left_hand", "right_hand", "left_wrist", "right_wrist")
REACHES, WINDOW = {"10_cm": 0.1, "15_cm": 0.15}, 0.25  # metres, seconds
# Metres from the giver's hand to the middle of the object that it holds, at the median.
HELD = 0.28
ROOT = "pelvis"
TRAINED, TESTED = "normal_*.npz", "variation_*.npz"
# Of the regression on the giver: seconds before the end, times a second, components, penalty.
SECONDS, RATE, COMPONENTS, RIDGE = 4.0, 12, 20, 1.0


@dataclass(frozen=True)
class Capture:
    """A recorded handover: its joints, both people (T, J, 3), the object (T, 3) and the times."""

    joints: list[str]
    giver: Array
    receiver: Array
    place: Array
    times: Array

    @property
    def transfer(self) -> int:
        """The frame in which both have a hand nearest to the object."""
        held, reached = (
            to_object(self.joints, motion, self.place) for motion in (self.giver, self.receiver)
        )
        return int(np.maximum(held - HELD, reached).argmin())


@dataclass(frozen=True)
class Reach:
    """How near a receiver's hand is to the object, and when; metres and seconds.

    Parameters
    ----------
    hand : at the captured transfer
    near : at least, within ``WINDOW`` of it
    own, own_time : at least, until so long after it; and when, from the transfer
    root : of the pelvis from the captured one over the floor, at the transfer
    """

    hand: float
    near: float
    own: float
    own_time: float
    root: float


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("files", type=Path, nargs="*", metavar="REACTIONS.parquet")
    options = parser.parse_args()
    figures: dict[str, float] = {}
    for number, file in enumerate(options.files or DEFAULT, start=1):
        if not file.is_file():
            raise SystemExit(f"{file}: no such file; ./run repro handover makes the reactions")
        found = list(measure(file))
        if not found:
            raise SystemExit(f"{file}: no reaction to a giver of {real_data() / 'handover'}")
        captured, generated = zip(*found, strict=True)
        figures |= summary("captured", captured) | summary(f"{number}", generated)
    show(figures | guesses(), as_json=options.json)


def summary(row: str, reaches: tuple[Reach, ...]) -> dict[str, float]:
    """Return the figures of a row."""
    of = {
        entry.name: np.array([getattr(reach, entry.name) for reach in reaches])
        for entry in fields(Reach)
    }
    figures = {f"{row}_{name}_m": float(np.median(of[name])) for name in ("hand", "root", "own")}
    for reach, metres in REACHES.items():
        figures[f"{row}_within_{reach}"] = float((of["near"] < metres).mean())
        figures[f"{row}_own_within_{reach}"] = float((of["own"] < metres).mean())
    figures[f"{row}_in_time"] = float((np.abs(of["own_time"]) <= WINDOW).mean())
    return figures


def measure(file: Path) -> Iterator[tuple[Reach, Reach]]:
    """Yield, of each reaction to a giver, the reach of the captured receiver and its own."""
    for name, reaction in stream_motions(file):
        clip, reacts, _ = name.split("#")
        if reacts == "b":
            capture = read_capture(real_data() / "handover" / f"{clip}.npz")
            own = reaction.skeleton
            yield (
                _reach(capture, capture.joints, capture.receiver),
                _reach(capture, list(own.joints), reaction.person_b),
            )


def _reach(capture: Capture, joints: list[str], motion: Motion | Array) -> Reach:
    at, distances = capture.transfer, to_object(joints, motion, capture.place)
    after = capture.times - capture.times[at]
    until = distances[after <= WINDOW]
    pelvis = capture.receiver[at, capture.joints.index(ROOT)]
    off = motion[at, joints.index(ROOT)] - pelvis
    return Reach(
        hand=distances[at],
        near=distances[np.abs(after) <= WINDOW].min(),
        own=until.min(),
        own_time=after[until.argmin()],
        root=float(np.hypot(off[0], off[2])),
    )


def read_capture(file: Path) -> Capture:
    """Read a handover."""
    with np.load(file, allow_pickle=False) as arrays:
        unit, up = float(arrays["unit"]), str(arrays["up"])
        motions = [
            to_y_up(arrays[name].astype(np.float64) * unit, up)
            for name in ("person_a", "person_b", "object")
        ]
        times = np.arange(len(motions[0])) / float(arrays["fps"])
        giver, receiver, place = motions
        return Capture(arrays["joints"].tolist(), giver, receiver, place, times)


def to_object(joints: list[str], motion: Motion | Array, place: Array) -> Array:
    """``(T,)`` metres from the nearest wrist or hand to the object."""
    hands = motion[:, [joints.index(name) for name in HANDS]].astype(np.float64)
    distances: Array = np.linalg.norm(hands - place[:, None], axis=-1).min(axis=1)
    return distances


def guesses() -> dict[str, float]:
    """Return how often the time of the transfer is guessed to ``WINDOW``."""
    (known, when), (tested, truth) = (
        _last_seconds(sorted((real_data() / "handover").glob(pattern)))
        for pattern in (TRAINED, TESTED)
    )
    guess = np.full(len(truth), np.median(when))
    mean = known.mean(axis=0)
    basis = np.linalg.svd(known - mean, full_matrices=False)[2][:COMPONENTS].T
    features = (known - mean) @ basis
    weights = np.linalg.solve(
        features.T @ features + RIDGE * np.eye(COMPONENTS), features.T @ (when - when.mean())
    )
    ridge = (tested - mean) @ basis @ weights + when.mean()
    return {
        f"{name}_in_time": float((np.abs(found - truth) <= WINDOW).mean())
        for name, found in (("guess", guess), ("ridge", ridge))
    }


def _last_seconds(files: list[Path]) -> tuple[Array, Array]:
    """Return the givers' last seconds ``(N, C)``, and how long before the end the transfers are."""
    givers, before = [], []
    for file in files:
        capture = read_capture(file)
        end = capture.times[-1]
        at = np.linspace(max(0.0, end - SECONDS), end, round(RATE * SECONDS) + 1)
        frames = np.searchsorted(capture.times, at - 1e-9)
        giver = capture.giver - capture.giver[-1:, [capture.joints.index(ROOT)]]
        givers.append(giver[frames].ravel())
        before.append(end - capture.times[capture.transfer])
    return np.array(givers), np.array(before)


if __name__ == "__main__":
    main()
