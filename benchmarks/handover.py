"""Whether generated receivers of recorded handovers take the object.

Usage: python -m benchmarks.handover [REACTIONS.parquet ...] [--json]

Reactions are of the experiment ``handover``, by default those of PaCMO and the regression in
``data/reactions/1``; those to the giver count. Under PACMO_REAL_DATA the captures state where the
object is, of which a model is told while it is held. The transfer is the instant at which both
captured people have a wrist or hand nearest to it. Of each file, and of the captured
receivers: ``hand_m`` the distance of the nearest wrist or hand to the object at the transfer,
median; ``within_10_cm`` and ``within_15_cm`` the shares of reactions in which it is so near, or is
within 0.25 s of it; ``root_m`` the error of the pelvis over the floor then, median.
"""

import statistics
from collections.abc import Iterator
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


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("files", type=Path, nargs="*", metavar="REACTIONS.parquet")
    options = parser.parse_args()
    figures: dict[str, float] = {}
    for number, file in enumerate(options.files or DEFAULT, start=1):
        if not file.is_file():
            raise SystemExit(f"{file}: no such file; ./run repro handover makes the reactions")
        found = np.array(list(measure(file)))
        if not len(found):
            raise SystemExit(f"{file}: no reaction to a giver of {real_data() / 'handover'}")
        for row, (at, near, root) in (("captured", found[:, :3].T), (f"{number}", found[:, 3:].T)):
            figures[f"{row}_hand_m"] = statistics.median(at)
            figures[f"{row}_root_m"] = statistics.median(root)
            for reach, metres in REACHES.items():
                figures[f"{row}_within_{reach}"] = float((near < metres).mean())
    show(figures, as_json=options.json)


def measure(file: Path) -> Iterator[list[float]]:
    """Yield, of each reaction to a giver, three distances of the captured one and its own."""
    for name, reaction in stream_motions(file):
        clip, reacts, _ = name.split("#")
        if reacts != "b":
            continue
        joints, giver, receiver, place = read_capture(clip)
        held, reached = (to_object(joints, motion, place) for motion in (giver, receiver))
        at = int(np.maximum(held - HELD, reached).argmin())
        near = np.abs(reaction.times - reaction.times[at]) <= WINDOW
        row: list[float] = []
        own, pelvis = reaction.skeleton, receiver[at, joints.index(ROOT)]
        for names, root, motion in (
            (joints, joints.index(ROOT), receiver),
            (list(own.joints), own.root, reaction.person_b),
        ):
            distances = to_object(names, motion, place)
            off = motion[at, root] - pelvis
            row += [distances[at], distances[near].min(), float(np.hypot(off[0], off[2]))]
        yield row


def read_capture(clip: str) -> tuple[list[str], Array, Array, Array]:
    """Return the joints of a handover, giver and receiver (T, J, 3), and the object (T, 3)."""
    with np.load(real_data() / "handover" / f"{clip}.npz", allow_pickle=False) as arrays:
        unit, up = float(arrays["unit"]), str(arrays["up"])
        motions = [
            to_y_up(arrays[name].astype(np.float64) * unit, up)
            for name in ("person_a", "person_b", "object")
        ]
        return arrays["joints"].tolist(), motions[0], motions[1], motions[2]


def to_object(joints: list[str], motion: Motion | Array, place: Array) -> Array:
    """``(T,)`` metres from the nearest wrist or hand to the object."""
    hands = motion[:, [joints.index(name) for name in HANDS]].astype(np.float64)
    distances: Array = np.linalg.norm(hands - place[:, None], axis=-1).min(axis=1)
    return distances


if __name__ == "__main__":
    main()
