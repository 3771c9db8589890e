"""What a process does with memory that it has freed."""

import ctypes

# The C library's numbers for what it is told (glibc, malloc.h).
_TRIM_THRESHOLD, _MMAP_MAX = -1, -4


def keep_freed_memory() -> None:
    """Keep what is freed for what is asked for next, until the process ends.

    glibc gives large pieces back to the system at once, and a training step asks for as many as the
    last one freed: to fetch them anew, a page at a time, is an eighth of a step of the skeleton
    prior. Other C libraries have no such setting and are left as they are.
    """
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(_MMAP_MAX, 0)
        library.mallopt(_TRIM_THRESHOLD, 2**31 - 1)
