"""What a file may cost: limits on its bytes and on the work that its motion makes.

A file is measured before it is read, a motion before it is computed. The limits leave several times
what published captures need; with them a reading takes less than a gigabyte and half a minute.
"""

import os
import stat
from collections.abc import Iterator
from pathlib import Path

MAX_BYTES = 128 << 20  # of a file; the largest published captures have a few megabytes
MAX_LINES = 2_000_000  # of a text file: nine minutes of CMU's 29 bones at 120 frames a second
MAX_LINE_BYTES = 1 << 20  # of a text file: eight times a row of 1000 joints
MAX_JOINTS = 1000  # of a person
MAX_POSITIONS = 4_000_000  # frames times joints: nine minutes of 60 joints at 120 frames a second
MAX_PAIRS = 400_000_000  # frames times pairs of both people's joints, whose distances are measured
MAX_GAP = 10.0  # seconds between frames: the lowest frame rate is 0.1
MIN_GAP = 1e-5  # seconds: a tenth of a frame at the highest frame rate, 10,000
MAX_COORDINATE_M = 1e4  # of a stored motion: ten times what a capture may have
MAX_SAMPLES = 1000  # that one command generates
MAX_PARAMETERS = 100_000_000  # of a network: ten times the largest here
MAX_GRID = 4096  # points of a network's time axis
MAX_FOLDER_BYTES = 3000  # of a folder's path: the system takes 4096 with what is in it
MAX_NUMBERS = 6 * MAX_POSITIONS  # in a table: a joint has up to six channels

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def file_fault(path: Path, max_bytes: int | None = MAX_BYTES) -> str:
    """Say why a path cannot be read as a file, without opening it; empty if it can.

    To open a named pipe would wait for its writer.

    Parameters
    ----------
    max_bytes : largest size; None where the file is read in parts
    """
    try:
        facts = path.stat()
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        return f"cannot be read: {getattr(error, 'strerror', None) or error}"
    if not stat.S_ISREG(facts.st_mode):
        return f"wanted a file; got {_KINDS.get(stat.S_IFMT(facts.st_mode), 'something else')}"
    if max_bytes is not None and facts.st_size > max_bytes:
        return f"wanted at most {max_bytes >> 20} MiB; got {facts.st_size / (1 << 20):.0f} MiB"
    return ""


def walk_files(root: Path, too_deep: list[Path] | None = None) -> Iterator[Path]:
    """Yield what lies below a folder but is no folder itself, in no order; links are not followed.

    ``Path.rglob`` fails on folders within folders that are deeper than Python's stack, or whose
    paths are longer than the system takes.

    Parameters
    ----------
    too_deep : collects the folders with a path of more than ``MAX_FOLDER_BYTES``, left out here
    """
    folders = [root] if root.is_dir() else []
    while folders:
        folder = folders.pop()
        if len(os.fsencode(folder)) > MAX_FOLDER_BYTES:
            if too_deep is not None:
                too_deep.append(folder)
            continue
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    folders.append(folder / entry.name)
                else:
                    yield folder / entry.name


def work_fault(frames: int, joints: int) -> str:
    """Say why a motion is too large to be computed; empty if it is not."""
    if joints > MAX_JOINTS:
        return f"wanted at most {MAX_JOINTS} joints; got {joints}"
    most = min(MAX_POSITIONS // max(joints, 1), MAX_PAIRS // max(joints, 1) ** 2)
    if frames > most:
        return f"wanted at most {most} frames of {joints} joints; got {frames}"
    return ""


def printable(text: str) -> str:
    """Escape the characters that a terminal would obey or cannot show: controls, surrogates."""
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii")
        for letter in text
    )
