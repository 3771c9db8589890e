"""``pacmo fetch``: download public datasets and verify their files.

SBU Kinect Interaction v2.0 (Yun et al., HAU3D-CVPRW 2012): the README.txt of the dataset, in the
same folder of its server, lists the 21 archives of the clean version and asks for research use and
a citation. Each archive holds colour and depth pictures besides the skeletons. The addresses are
from that file and untested; ``--base-url`` names a mirror.

CMU Graphics Lab Motion Capture Database: free for research and in products, not to be resold as
data; it asks for the acknowledgement "The data used in this project was obtained from
mocap.cs.cmu.edu. The database was created with funding from NSF EIA-0196217." Addresses follow
the rule of the site, ``subjects/<subject>/<subject>.asf`` and ``<subject>_<trial>.amc``. The
numbers of trials are from the index of the database; a listed trial may be absent from the server.
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
from pacmo_core.formats.cmu import CMU_PAIRS
from pacmo_core.project.workspace import CommandError, errors_in_one_line


@dataclass(frozen=True)
class OpenDataset:
    """A dataset on a web server.

    Parameters
    ----------
    name : of the subcommand
    folder : relative to the destination
    base_url : address of its files, without a slash at the end
    parts : valid values of ``--only``
    files : from a part to its files, relative to ``base_url``
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

CMU_TRIALS = {"18": 15, "20": 13, "22": 25, "33": 2, "60": 15}  # of each subject of the pair


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


Follow = Callable[[str], Report]  # from the name of a file to the callback for its progress


class MismatchError(CommandError):
    """A file was downloaded completely and has another checksum than expected."""


@dataclass
class Outcome:
    """Files of a run, as paths relative to the destination, and its errors."""

    existing: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)
    faults: list[CommandError] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class Fetcher:
    """Download files and verify their checksums.

    Parameters
    ----------
    client : for all requests
    sums : expected checksums, and the destination
    retry : how often and how long to retry
    follow : shows progress
    accept_changed : accept files that differ from their checksums, and record the new ones
    """

    client: httpx.Client
    sums: Checksums
    retry: RetryPolicy
    follow: Follow
    accept_changed: bool

    def fetch_file(self, url: str, place: str, outcome: Outcome) -> None:
        """Download ``url`` to ``place`` unless a verified file is there."""
        if self.sums.verified(place):
            outcome.existing.append(place)
            return
        part = self._download(url, self.sums.root / place)
        self._settle(part, place)
        outcome.fetched.append(place)

    def fetch_archive(self, url: str, folder: str, outcome: Outcome) -> None:
        """Extract the skeletons of the archive at ``url`` to ``folder``; remove the archive."""
        known = self.sums.places(folder)
        if known and all(self.sums.verified(path) for path in known):
            outcome.existing.extend(known)
            return
        archive = self._download(url, self.sums.root / f"{folder}.zip")
        try:
            extracted = self._unpack(archive, folder, outcome)
        except ArchiveError:
            archive.discard()  # so that the next run downloads it again
            raise
        archive.discard()
        if missing := sorted(set(known) - extracted):
            raise MismatchError(f"{url}: {len(missing)} files are missing, first {missing[0]}")

    def _unpack(self, archive: PartialFile, folder: str, outcome: Outcome) -> set[str]:
        extracted = set()
        for name, content in extract_skeletons(archive.file):
            path = f"{folder}/{name}"
            part = PartialFile(self.sums.root / path)
            part.file.parent.mkdir(parents=True, exist_ok=True)
            part.file.write_bytes(content)
            extracted.add(path)
            try:
                self._settle(part, path)
                outcome.fetched.append(path)
            except MismatchError as fault:
                outcome.faults.append(fault)
        return extracted

    def _download(self, url: str, target: Path) -> PartialFile:
        part = PartialFile(target)
        download(self.client, url, part, self.retry, self.follow(target.name))
        return part

    def _settle(self, part: PartialFile, place: str) -> None:
        """Rename the complete file if its checksum is the expected one.

        An unverified file of that name, or one that fails the check, is renamed to ``.aside``.
        """
        target = self.sums.root / place
        expected, got = self.sums.wanted(place), sha256_of(part.file)
        aside = target.with_name(f"{target.name}.aside")
        if target.exists() and not self.sums.verified(place):
            target.replace(aside)
        if expected not in (None, got) and not self.accept_changed:
            part.move_to(aside)
            raise MismatchError(
                f"{target}: wanted SHA-256 {expected}, got {got}; renamed to {aside.name}"
            )
        self.sums.record(place, got)
        part.move_to(target)


def fetch_dataset(
    source: OpenDataset, fetcher: Fetcher, base_url: str, parts: list[str]
) -> Outcome:
    """Download the named parts of a dataset, or all, one file after another.

    A file that is not on the server, or fails its check, does not stop the others.

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


app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None)

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
BaseUrl = Annotated[str | None, typer.Option(help="address of a mirror (http or https)")]
Only = Annotated[list[str] | None, typer.Option(help="download this part only; may be repeated")]
AcceptChanged = Annotated[
    bool, typer.Option("--accept-changed", help="accept files that differ from their checksums")
]


@app.callback()
def fetch_help() -> None:
    """Download a public dataset.

    A second run downloads only missing files, and an interrupted download continues where it
    stopped. Every file is verified by its SHA-256 checksum: the one that comes with this program
    if there is one, otherwise that of the first download, which is recorded in DEST/SHA256SUMS.
    A file that does not match is renamed to NAME.aside and reported. Behind a proxy, set
    HTTP_PROXY and HTTPS_PROXY.
    """


@app.command("sbu", epilog=_SBU_EXAMPLES)
def fetch_sbu(
    dest: Dest,
    base_url: BaseUrl = None,
    only: Only = None,
    accept_changed: AcceptChanged = False,
) -> None:
    """Download SBU: 21 pairs of people, 8 actions.

    SBU Kinect Interaction v2.0, clean version, 282 takes; for research; a citation is asked for.
    Only the skeletons are kept, as DEST/sbu/<pair>/<action>/<take>/skeleton_pos.txt; the archives
    also hold pictures, so that the downloads are much larger than the result.
    """
    _run(SBU, dest, base_url, only or [], accept_changed)


@app.command("cmu-two-person", epilog=_CMU_EXAMPLES)
def fetch_cmu(
    dest: Dest,
    base_url: BaseUrl = None,
    only: Only = None,
    accept_changed: AcceptChanged = False,
) -> None:
    """Download the CMU pairs: 10 subjects, 70 trials.

    CMU motion capture of subjects 18/19, 20/21, 22/23, 33/34 and 60/61, each pair recorded
    together; an acknowledgement is asked for. Saved as
    DEST/cmu_two_person/<subject>/<subject>.asf and <subject>_<trial>.amc.
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
            retry=RETRY_POLICY,
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
    """Show a progress bar on stderr for the current file; nothing without a terminal."""
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
        f"{source.name}: {len(outcome.fetched)} files downloaded, {len(outcome.existing)} existing "
        f"verified, in {dest / source.folder}; checksums in {dest / FILE_NAME}"
    )


def _failures(faults: list[CommandError]) -> str:
    more = f" (and {len(faults) - 1} more files)" if len(faults) > 1 else ""
    return f"{faults[0]}{more}"
