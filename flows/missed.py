"""Nights that were missed are caught up once, by the next that runs."""

from datetime import datetime, timedelta

from prefect.server.schemas.schedules import CronSchedule

from apps.records import DONE, FAILED, HELD, Run

_BEGAN = (DONE, HELD, FAILED)
_LOOK_BACK = timedelta(days=40)


def is_covered(scheduled: datetime | None, runs: list[Run], now: datetime) -> bool:
    """Tell whether a night that began since then has done the work of a scheduled one.

    After a week's absence a server starts seven late nights. The first takes in all that lies
    there; the six others come here after it.

    Parameters
    ----------
    scheduled : when the night was to start; None for one that a person starts
    runs : what has run, this one's record among them
    now : the time; a night that began later than this was begun by a clock that has jumped back
    """
    began = [datetime.fromisoformat(run.started) for run in _nights(runs)]
    return scheduled is not None and any(scheduled <= start <= now for start in began)


async def is_missed(cron: str, timezone: str, runs: list[Run], now: datetime) -> bool:
    """Tell whether no night has begun since the schedule last asked for one.

    Where there never was a night, none is missed: the first comes at its hour.
    """
    nights = _nights(runs)
    if not nights:
        return False
    schedule = CronSchedule(cron=cron, timezone=timezone)
    asked = await schedule.get_dates(n=1000, start=now - _LOOK_BACK, end=now)
    return bool(asked) and not is_covered(asked[-1], runs, now)


def _nights(runs: list[Run]) -> list[Run]:
    return [run for run in runs if run.job == "nightly" and run.outcome in _BEGAN]
