"""Speed of reading NTU skeleton files, against a plain reader that reads line by line.

Usage: python -m benchmarks.reading [--json]

Both read the same files in the same run, in turn, on one thread; figures are medians of process
time, which other work on the machine disturbs least.
"""

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks._captures import real_data
from benchmarks._figures import arguments, show
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.ntu import Ntu
from pacmo_core.formats.write_ntu import format_ntu

MEGABYTES = 30
N_FRAMES = 90
N_ROUNDS = 5
BODY_IDS = (72057594037932185, 72057594037932127)
NTU = Ntu(fps=30, max_gap=0, max_link_distance=0, min_visible_share=1)


def main() -> None:
    """Measure and print."""
    options = arguments(__doc__ or "").parse_args()
    with tempfile.TemporaryDirectory() as folder:
        n_bytes = write_clips(Path(folder), MEGABYTES * 10**6)
        figures = compare(NTU.find(Path(folder)), n_bytes)
    real = sorted(real_data().glob("ntu/two*/*"))
    if real:
        n_bytes = sum(path.stat().st_size for path in real)
        published = compare(NTU.find(real[0].parent) * 20, 20 * n_bytes)
        figures |= {f"published_{name}": value for name, value in published.items()}
    show(figures, as_json=options.json)


def write_clips(folder: Path, n_bytes: int) -> int:
    """Write at least ``n_bytes`` of random clips of two people."""
    generator = np.random.default_rng(0)
    written = 0
    while written < n_bytes:
        walk = generator.normal([0, 0, 3], 0.3, size=(2, 1, 25, 3)) + np.cumsum(
            generator.normal(scale=0.005, size=(2, N_FRAMES, 25, 3)), axis=1
        )
        people = walk.clip([-9, -9, 0.5], 9).astype(np.float32)
        clip = Interaction(NTU25, np.arange(N_FRAMES) / 30, *people)
        written += (folder / f"{written:012d}.skeleton").write_bytes(format_ntu(clip, BODY_IDS))
    return written


def compare(sequences: list[RawSequence], n_bytes: int) -> dict[str, float]:
    """Time both readers in turn; MB are 10^6 bytes."""
    rounds = [
        (seconds(read_ours, sequences), seconds(read_plainly, sequences)) for _ in range(N_ROUNDS)
    ]
    (ours, our_wall), (plain, _) = (
        tuple(map(statistics.median, zip(*runs, strict=True))) for runs in zip(*rounds, strict=True)
    )
    return {
        "skeleton_mb_per_s": n_bytes / 1e6 / ours,
        "skeleton_mb_per_s_wall": n_bytes / 1e6 / our_wall,
        "plain_mb_per_s": n_bytes / 1e6 / plain,
        "times_plain_reader": statistics.median(p[0] / o[0] for o, p in rounds),
    }


def seconds(
    read: Callable[[RawSequence], object], sequences: list[RawSequence]
) -> tuple[float, float]:
    """Return the process time and the wall time to read all files."""
    process, wall = time.process_time(), time.perf_counter()
    for sequence in sequences:
        read(sequence)
    return time.process_time() - process, time.perf_counter() - wall


def read_ours(sequence: RawSequence) -> object:
    """Read with all checks, as ingestion does."""
    return NTU.read(sequence)


def read_plainly(sequence: RawSequence) -> object:
    """Read line by line into two arrays without checks, as public loaders do."""
    people: dict[str, list[list[list[float]]]] = {}
    with sequence.files[0].open() as lines:
        for _ in range(int(next(lines))):
            for _ in range(int(next(lines))):
                body_id = next(lines).split()[0]
                joints = [list(map(float, next(lines).split())) for _ in range(int(next(lines)))]
                people.setdefault(body_id, []).append([joint[:3] for joint in joints])
    return {body_id: np.array(poses, dtype=np.float32) for body_id, poses in people.items()}


if __name__ == "__main__":
    main()
