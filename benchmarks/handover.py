"""Whether generated receivers of recorded handovers take the object.

Usage: python -m benchmarks.handover [REACTIONS.parquet ...] [--json]

Reactions are of the experiment ``handover``, by default those of PaCMO and the regression in
``data/reactions/1``; those to the giver count. Under PACMO_REAL_DATA the captures state where the
object is, of which a model is told while it is held. The transfer is the instant at which both
captured people have a wrist or hand nearest to it. Of each file, of the captured receivers, and of
one who stands still:

``hand_m`` is the distance of the nearest wrist or hand to the object at the transfer, median;
``within_10_cm``, ``within_15_cm`` and ``within_20_cm`` the shares of reactions in which it is so
near then; ``root_m`` the error of the pelvis over the floor, median. A quarter of a second to spare
is not given: the giver carries the object past a receiver who does nothing, too.

``still`` is that receiver: the captured one of the training handover that is most like the others
at its transfer, in its place beside its own giver's first pose, motionless.

``guess_in_time`` and ``ridge_in_time`` are two predictions of the transfer from the giver, with no
claim to be the best: the shares of tested captures in which it is within 0.25 s of its median time
before the end of the training captures, and of a ridge regression on the giver's last four seconds.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks._captures import real_data
from benchmarks._figures import arguments, show
from pacmo_core.data.interaction import Motion
from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.data.transforms import Frame, body_frame
from pacmo_core.formats.base import to_y_up
from pacmo_core.store.motions import stream_motions

Array = NDArray[np.float64]

REACTIONS = Path("data/reactions/1")
DEFAULT = [REACTIONS / row / "1/motions.parquet" for row in ("pacmo", "regression")]
HANDS = ("left_hand", "right_hand", "left_wrist", "right_wrist")
REACHES = {"10_cm": 0.1, "15_cm": 0.15, "20_cm": 0.2}  # metres
WINDOW = 0.25  # seconds from the transfer to a prediction of it that counts
# Metres from the giver's hand to the middle of the object that it holds, at the median.
HELD = 0.28
ROOT = "pelvis"
TRAINED, TESTED = "normal_*.npz", "variation_*.npz"
# Of the regression on the giver: seconds before the end, times a second, components, penalty.
SECONDS, RATE, COMPONENTS, RIDGE = 4.0, 12, 20, 1.0


@dataclass(frozen=True)
class Capture:
    """A recorded handover: joints, both people (T, J, 3), the object (T, 3), times, parents."""

    joints: list[str]
    giver: Array
    receiver: Array
    place: Array
    times: Array
    parents: tuple[int, ...]

    @property
    def transfer(self) -> int:
        """The frame in which both have a hand nearest to the object."""
        held, reached = (
            to_object(self.joints, motion, self.place) for motion in (self.giver, self.receiver)
        )
        return int(np.maximum(held - HELD, reached).argmin())

    @property
    def first_frame(self) -> Frame:
        """The frame of the giver's first pose."""
        skeleton = Skeleton(
            "table", tuple(self.joints), self.parents, mirror_by_name(tuple(self.joints))
        )
        return body_frame(self.giver[:1].astype(np.float32), skeleton)


@dataclass(frozen=True)
class Reach:
    """How near a receiver is at the captured transfer, in metres.

    Parameters
    ----------
    hand : from the nearest wrist or hand to the object
    root : from the pelvis to the captured one, over the floor
    """

    hand: float
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
    show(figures | summary("still", still_receivers()) | guesses(), as_json=options.json)


def summary(row: str, reaches: tuple[Reach, ...]) -> dict[str, float]:
    """Return the figures of a row."""
    of = {
        entry.name: np.array([getattr(reach, entry.name) for reach in reaches])
        for entry in fields(Reach)
    }
    figures = {f"{row}_{name}_m": float(np.median(of[name])) for name in ("hand", "root")}
    for reach, metres in REACHES.items():
        figures[f"{row}_within_{reach}"] = float((of["hand"] < metres).mean())
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
    at = capture.transfer
    pelvis = capture.receiver[at, capture.joints.index(ROOT)]
    off = motion[at, joints.index(ROOT)] - pelvis
    hand = to_object(joints, motion[at : at + 1], capture.place[at : at + 1])
    return Reach(float(hand[0]), float(np.hypot(off[0], off[2])))


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
        parents = tuple(arrays["parents"].tolist())
        return Capture(arrays["joints"].tolist(), giver, receiver, place, times, parents)


def to_object(joints: list[str], motion: Motion | Array, place: Array) -> Array:
    """``(T,)`` metres from the nearest wrist or hand to the object."""
    hands = motion[:, [joints.index(name) for name in HANDS]].astype(np.float64)
    distances: Array = np.linalg.norm(hands - place[:, None], axis=-1).min(axis=1)
    return distances


def still_receivers() -> tuple[Reach, ...]:
    """Return how near a receiver comes who stands still, in each tested handover."""
    poses = []
    for file in handovers(TRAINED):
        capture = read_capture(file)
        poses.append(capture.first_frame.to_local(capture.receiver[capture.transfer]))
    distances = np.linalg.norm(np.array(poses)[:, None] - np.array(poses), axis=-1).mean(axis=-1)
    usual = poses[int(np.median(distances, axis=1).argmin())]
    reaches = []
    for file in handovers(TESTED):
        capture = read_capture(file)
        pose = capture.first_frame.to_world(usual)
        reaches.append(_reach(capture, capture.joints, np.tile(pose, (len(capture.times), 1, 1))))
    return tuple(reaches)


def handovers(pattern: str) -> list[Path]:
    """List the files of handovers."""
    return sorted((real_data() / "handover").glob(pattern))


def guesses() -> dict[str, float]:
    """Return how often the time of the transfer is guessed to ``WINDOW``."""
    (known, when), (tested, truth) = (
        _last_seconds(handovers(pattern)) for pattern in (TRAINED, TESTED)
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
