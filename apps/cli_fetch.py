"""``pacmo fetch``: the open data sets, by one command each."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import httpx
import typer
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

from apps.checksums import FILE_NAME, Sums, shipped
from apps.download import Patience, Report
from apps.fetch import Fetcher, Follow, Outcome, fetch
from apps.sources import CMU, SBU, Source
from pacmo_core.project.workspace import CommandError, errors_in_one_line

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)

_SBU_EXAMPLES = """\b
Examples:
  pacmo fetch sbu data/captures
  pacmo fetch sbu data/captures --only s01s02 --only s01s03
  pacmo fetch sbu data/captures --base-url https://mirror.example/sbu
"""
_CMU_EXAMPLES = """\b
Examples:
  pacmo fetch cmu-two-person data/captures
  pacmo fetch cmu-two-person data/captures --only 18 --only 19
"""

PATIENCE = Patience(attempts=4, first_wait=1.0, timeout=30.0)

Dest = Annotated[
    Path, typer.Argument(metavar="DEST", help="folder of all captures, e.g. data/captures")
]
BaseUrl = Annotated[
    str | None, typer.Option(help="where the files are instead, e.g. a mirror (http or https)")
]
Only = Annotated[
    list[str] | None, typer.Option(help="fetch this part only; may be given more than once")
]
AcceptChanged = Annotated[
    bool, typer.Option("--accept-changed", help="take files that differ from their known sums")
]


@app.callback()
def about() -> None:
    """Fetch a data set that anyone may download.

    Run again, it fetches what is missing and nothing else. A download that was cut goes on
    where it stopped. Every file is held against its SHA-256: the sum shipped with this program
    where there is one, else the sum of the first download, which is written to DEST/SHA256SUMS
    and binds every later run. A file that does not match is set aside as NAME.aside and named.
    Behind a proxy, set HTTP_PROXY and HTTPS_PROXY.
    """


@app.command("sbu", epilog=_SBU_EXAMPLES)
def fetch_sbu(
    dest: Dest,
    base_url: BaseUrl = None,
    only: Only = None,
    accept_changed: AcceptChanged = False,
) -> None:
    """Fetch SBU: 21 pairs of people, 8 acts.

    SBU Kinect Interaction v2.0, clean version, 282 takes; for research, citation asked. Only
    the skeletons are kept, as DEST/sbu/<pair>/<action>/<take>/skeleton_pos.txt; the archives
    also hold pictures, so much more is downloaded than stays.
    """
    _run(SBU, dest, base_url, only or [], accept_changed)


@app.command("cmu-two-person", epilog=_CMU_EXAMPLES)
def fetch_cmu(
    dest: Dest,
    base_url: BaseUrl = None,
    only: Only = None,
    accept_changed: AcceptChanged = False,
) -> None:
    """Fetch CMU's pairs: 10 subjects, 70 trials.

    CMU motion capture of subjects 18/19, 20/21, 22/23, 33/34 and 60/61, each pair recorded
    together; acknowledgement asked. Kept as DEST/cmu_two_person/<subject>/<subject>.asf and
    <subject>_<trial>.amc.
    """
    _run(CMU, dest, base_url, only or [], accept_changed)


def _run(
    source: Source, dest: Path, base_url: str | None, only: list[str], accept_changed: bool
) -> None:
    _check_usage(source, base_url, only)
    with errors_in_one_line(), _client() as client, _progress() as follow:
        dest.mkdir(parents=True, exist_ok=True)
        fetcher = Fetcher(
            client=client,
            sums=Sums(dest, shipped()),
            patience=PATIENCE,
            follow=follow,
            accept_changed=accept_changed,
        )
        outcome = fetch(source, fetcher, base_url or source.base_url, only)
        typer.echo(_summary(source, dest, outcome))
        if outcome.faults:
            raise CommandError(_faults(outcome.faults))


def _check_usage(source: Source, base_url: str | None, only: list[str]) -> None:
    if unknown := [part for part in only if part not in source.parts]:
        wanted = ", ".join(source.parts)
        raise typer.BadParameter(f"--only {unknown[0]}: {source.name} has {wanted}")
    if base_url is not None and not _is_web_address(base_url):
        raise typer.BadParameter(f"--base-url must be an http or https address; got {base_url!r}")


def _is_web_address(text: str) -> bool:
    try:
        url = httpx.URL(text)
    except httpx.InvalidURL:
        return False
    return url.scheme in ("http", "https") and bool(url.host)


def _client() -> httpx.Client:
    return httpx.Client(
        timeout=PATIENCE.timeout, follow_redirects=True, headers={"User-Agent": "pacmo"}
    )


@contextmanager
def _progress() -> Iterator[Follow]:
    """Show a bar a file on stderr, gone when the file is there; nothing without a terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn())
    console = Console(stderr=True)
    with Progress(
        *columns,
        TransferSpeedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as progress:
        bar = progress.add_task("", total=None)

        def follow(name: str) -> Report:
            progress.reset(bar, description=name, total=None)
            return lambda done, total: progress.update(bar, completed=done, total=total)

        yield follow


def _summary(source: Source, dest: Path, outcome: Outcome) -> str:
    return (
        f"{source.name}: {len(outcome.fetched)} files fetched, {len(outcome.there)} already there "
        f"and verified, in {dest / source.folder}; sums in {dest / FILE_NAME}"
    )


def _faults(faults: list[CommandError]) -> str:
    more = f" (and {len(faults) - 1} more files)" if len(faults) > 1 else ""
    return f"{faults[0]}{more}"
