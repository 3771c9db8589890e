"""Where the openly downloadable data sets are, and which files belong to them.

SBU Kinect Interaction v2.0 (Yun et al., HAU3D-CVPRW 2012): the data set's own README.txt, which
stands in the same folder, lists the 21 archives of the clean version by these addresses and asks
for research use and a citation. Each archive holds colour and depth pictures besides the
skeletons. Not tried from here: the server may have moved since; ``--base-url`` names a mirror.

CMU Graphics Lab Motion Capture Database: free for research and in products, not to be resold as
data; it asks for the acknowledgement "The data used in this project was obtained from
mocap.cs.cmu.edu. The database was created with funding from NSF EIA-0196217." Addresses follow
the site's own rule, ``subjects/<subject>/<subject>.asf`` and ``<subject>_<trial>.amc``. The counts
of trials are the database index's; a trial that is listed may be absent from the server.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import httpx
import typer
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TransferSpeedColumn

from pacmo_core.commands.download import (
    FILE_NAME,
    ArchiveError,
    Checksums,
    MissingError,
    PartialFile,
    Report,
    RetryPolicy,
    download,
    extract_skeletons,
    sha256_of,
    shipped_checksums,
)
from pacmo_core.project.workspace import CommandError, errors_in_one_line


@dataclass(frozen=True)
class OpenDataset:
    """A data set on a web server.

    Parameters
    ----------
    name : what it is fetched by
    folder : its folder under the destination
    base_url : where its files are, without a slash at the end
    parts : what ``--only`` may name
    files : a part's files, relative to ``base_url``
    """

    name: str
    folder: str
    base_url: str
    parts: tuple[str, ...]
    files: Callable[[str], list[str]]


_PAIRS_OF_PEOPLE = """
s01s02 s01s03 s01s07 s02s01 s02s03 s02s06 s02s07 s03s02 s03s04 s03s05 s03s06
s04s02 s04s03 s04s06 s05s02 s05s03 s06s02 s06s03 s06s04 s07s01 s07s03
"""


def _sbu_files(pair: str) -> list[str]:
    return [f"{pair}.zip"]


SBU = OpenDataset(
    name="sbu",
    folder="sbu",
    base_url="http://vision.cs.stonybrook.edu/~kiwon/Datasets/SBU_Kinect_Interactions",
    parts=tuple(_PAIRS_OF_PEOPLE.split()),
    files=_sbu_files,
)

# Two subjects recorded together: the same trial number is the same instant.
CMU_PAIRS = (("18", "19"), ("20", "21"), ("22", "23"), ("33", "34"), ("60", "61"))
CMU_TRIALS = {"18": 15, "20": 13, "22": 25, "33": 2, "60": 15}  # of either subject of the pair


def _cmu_files(subject: str) -> list[str]:
    first = next(pair[0] for pair in CMU_PAIRS if subject in pair)
    trials = range(1, CMU_TRIALS[first] + 1)
    names = [f"{subject}.asf", *(f"{subject}_{trial:02d}.amc" for trial in trials)]
    return [f"{subject}/{name}" for name in names]


CMU = OpenDataset(
    name="cmu-two-person",
    folder="cmu_two_person",
    base_url="http://mocap.cs.cmu.edu/subjects",
    parts=tuple(subject for pair in CMU_PAIRS for subject in pair),
    files=_cmu_files,
)


Follow = Callable[[str], Report]  # the name of a file that begins -> who hears of its bytes


class MismatchError(CommandError):
    """A file came whole and does not hold what it should."""


@dataclass
class Outcome:
    """What a run of fetching did, by place under the destination."""

    there: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)
    faults: list[CommandError] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Fetcher:
    """All that fetching a file needs.

    Parameters
    ----------
    client : speaks to the server
    sums : what the files should hold, and the folder where they go
    patience : how long to bear with the server
    follow : shows progress
    accept_changed : take the server's file where it differs from a sum, and record its own
    """

    client: httpx.Client
    sums: Checksums
    patience: RetryPolicy
    follow: Follow
    accept_changed: bool

    def fetch_file(self, url: str, place: str, outcome: Outcome) -> None:
        """Bring ``url`` to ``place`` unless a verified file stands there."""
        if self.sums.verified(place):
            outcome.there.append(place)
            return
        part = self._download(url, self.sums.root / place)
        self._settle(part, place)
        outcome.fetched.append(place)

    def fetch_archive(self, url: str, folder: str, outcome: Outcome) -> None:
        """Bring the skeletons of the archive at ``url`` to ``folder``, then drop the archive."""
        known = self.sums.places(folder)
        if known and all(self.sums.verified(path) for path in known):
            outcome.there.extend(known)
            return
        archive = self._download(url, self.sums.root / f"{folder}.zip")
        try:
            came = self._unpack(archive, folder, outcome)
        except ArchiveError:
            archive.discard()  # so that the next run does not meet the same bytes again
            raise
        archive.discard()
        if lacking := sorted(set(known) - came):
            raise MismatchError(f"{url}: lacks {len(lacking)} files, first {lacking[0]}")

    def _unpack(self, archive: PartialFile, folder: str, outcome: Outcome) -> set[str]:
        came = set()
        for name, content in extract_skeletons(archive.file):
            path = f"{folder}/{name}"
            part = PartialFile(self.sums.root / path)
            part.file.parent.mkdir(parents=True, exist_ok=True)
            part.file.write_bytes(content)
            came.add(path)
            try:
                self._settle(part, path)
                outcome.fetched.append(path)
            except MismatchError as fault:
                outcome.faults.append(fault)
        return came

    def _download(self, url: str, target: Path) -> PartialFile:
        part = PartialFile(target)
        download(self.client, url, part, self.patience, self.follow(target.name))
        return part

    def _settle(self, part: PartialFile, place: str) -> None:
        """Give the whole file its name if it holds what it should.

        Whatever stood there unverified, and a file that failed, is set aside as ``.aside``.
        """
        target, expected, got = (
            self.sums.root / place,
            self.sums.wanted(place),
            sha256_of(part.file),
        )
        aside = target.with_name(f"{target.name}.aside")
        if target.exists() and not self.sums.verified(place):
            target.replace(aside)
        if expected not in (None, got) and not self.accept_changed:
            part.move_to(aside)
            raise MismatchError(
                f"{target}: wanted SHA-256 {expected}, got {got}; set aside as {aside.name}"
            )
        self.sums.record(place, got)
        part.move_to(target)


def fetch_dataset(
    source: OpenDataset, fetcher: Fetcher, base_url: str, parts: list[str]
) -> Outcome:
    """Fetch the named parts of a source, or all, one file after another.

    A file that the server lacks, or that does not hold what it should, does not stop the rest.

    Raises
    ------
    CommandError
        If the server cannot be reached or keeps failing.
    """
    outcome = Outcome()
    for file in [file for part in parts or source.parts for file in source.files(part)]:
        url, path = f"{base_url.rstrip('/')}/{file}", f"{source.folder}/{file}"
        try:
            if file.endswith(".zip"):
                fetcher.fetch_archive(url, path.removesuffix(".zip"), outcome)
            else:
                fetcher.fetch_file(url, path, outcome)
        except (MissingError, MismatchError, ArchiveError) as fault:
            outcome.faults.append(fault)
    return outcome


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

RETRY_POLICY = RetryPolicy(attempts=4, first_wait=1.0, timeout=30.0)

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
def fetch_help() -> None:
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
    source: OpenDataset, dest: Path, base_url: str | None, only: list[str], accept_changed: bool
) -> None:
    _check_usage(source, base_url, only)
    with errors_in_one_line(), _client() as client, _progress() as follow:
        dest.mkdir(parents=True, exist_ok=True)
        fetcher = Fetcher(
            client=client,
            sums=Checksums(dest, shipped_checksums()),
            patience=RETRY_POLICY,
            follow=follow,
            accept_changed=accept_changed,
        )
        outcome = fetch_dataset(source, fetcher, base_url or source.base_url, only)
        typer.echo(_summary(source, dest, outcome))
        if outcome.faults:
            raise CommandError(_failures(outcome.faults))


def _check_usage(source: OpenDataset, base_url: str | None, only: list[str]) -> None:
    if unknown := [part for part in only if part not in source.parts]:
        expected = ", ".join(source.parts)
        raise typer.BadParameter(f"--only {unknown[0]}: {source.name} has {expected}")
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
        timeout=RETRY_POLICY.timeout, follow_redirects=True, headers={"User-Agent": "pacmo"}
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


def _summary(source: OpenDataset, dest: Path, outcome: Outcome) -> str:
    return (
        f"{source.name}: {len(outcome.fetched)} files fetched, {len(outcome.there)} already there "
        f"and verified, in {dest / source.folder}; sums in {dest / FILE_NAME}"
    )


def _failures(faults: list[CommandError]) -> str:
    more = f" (and {len(faults) - 1} more files)" if len(faults) > 1 else ""
    return f"{faults[0]}{more}"
