"""Live curves while a training runs, in an untracked folder, by DVCLive."""

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from dvclive.live import Live

LIVE = Path("live")


class LiveCurve:
    """Adds epochs to a curve that ``dvc plots show`` and editors draw as it grows."""

    def __init__(self, live: Live) -> None:
        self._live = live

    def add(self, epoch: int, terms: Mapping[str, float]) -> None:
        """Add one epoch, from 1."""
        self._live.step = epoch
        for name, value in terms.items():
            self._live.log_metric(name, value, timestamp=False)
        self._live.make_summary()  # type: ignore[no-untyped-call]  # dvclive leaves it so


@contextmanager
def live_curve(folder: Path, so_far: Iterable[Mapping[str, float]]) -> Iterator[LiveCurve]:
    """Open ``live/FOLDER``, begun anew with the epochs that a checkpoint holds."""
    # Nothing leaves this machine unless its user has said otherwise.
    os.environ.setdefault("DVC_STUDIO_OFFLINE", "true")
    place = str(LIVE / folder.relative_to(folder.anchor))
    with Live(place, save_dvc_exp=False, dvcyaml=None, monitor_system=False) as live:
        curve = LiveCurve(live)
        for epoch, terms in enumerate(so_far, start=1):
            curve.add(epoch, terms)
        yield curve
