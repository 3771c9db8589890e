"""Bytes read for one clip of 1,000, relative to reading the whole file.

Usage: python -m benchmarks.store [--json]

``bytes_read_share``: bytes that the system was asked for, to read one clip, over those for
streaming the file. ``size_share_of_raw``: the file over the same arrays as plain float32.
The peer in the same run is pyarrow's default writer (snappy, dictionary).
"""

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median

import numpy as np
import pyarrow.parquet as pq

from benchmarks._figures import arguments, show
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import NTU25
from pacmo_core.store.motions import read_motion, stream_motions, write_motions

N_CLIPS = 1000
N_FRAMES = 90


def bytes_read(action: Callable[[], object]) -> int:
    """Count the bytes that this process asks the system for during an action."""
    counts = Path("/proc/self/io")
    before, overhead = (_read_characters(counts.read_text()) for _ in range(2))
    action()
    after = _read_characters(counts.read_text())
    return after - overhead - (overhead - before)


def _read_characters(text: str) -> int:
    return int(text.split()[1])


def make_clip(random: np.random.Generator) -> Interaction:
    """Sample a smooth motion with the noise of a depth camera."""
    shape = (N_FRAMES, len(NTU25.joints), 3)
    motions = [
        np.cumsum(0.01 * random.standard_normal(shape), axis=0)
        + random.standard_normal(shape[1:])
        + 0.005 * random.standard_normal(shape)
        for _ in range(2)
    ]
    times = np.arange(N_FRAMES) / 30
    return Interaction(NTU25, times, *(motion.astype(np.float32) for motion in motions))


def main() -> None:
    """Measure and print."""
    options = arguments(__doc__ or "").parse_args()
    random = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "motions.parquet"
        with write_motions(path, NTU25) as writer:
            for number in range(N_CLIPS):
                writer.add(f"clip{number:04d}", make_clip(random))
        whole = bytes_read(lambda: [None for _ in stream_motions(path)])
        names = [f"clip{number:04d}" for number in random.integers(0, N_CLIPS, 21)]
        one = median(bytes_read(partial(read_motion, path, name)) for name in names)
        plain = Path(folder) / "plain.parquet"
        pq.write_table(pq.read_table(path), plain)
        filters = [("clip", "==", names[0])]
        peer = bytes_read(lambda: pq.read_table(plain, filters=filters))
        raw = N_CLIPS * N_FRAMES * 2 * len(NTU25.joints) * 3 * 4
        figures = {
            "bytes_read_share": one / whole,
            "bytes_read_share_peer": peer / whole,
            "bytes_read_one_clip": one,
            "size_share_of_raw": path.stat().st_size / raw,
            "size_share_of_raw_peer": plain.stat().st_size / raw,
        }
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
