"""Fetch the data sets that anyone may download, whole and checked, or say why not."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from apps.archive import ArchiveError, skeletons
from apps.checksums import Sums, digest
from apps.download import MissingError, Patience, Report, download
from apps.part import Part
from apps.sources import Source
from pacmo_core.project.workspace import CommandError

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
    sums: Sums
    patience: Patience
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
        if known and all(self.sums.verified(place) for place in known):
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

    def _unpack(self, archive: Part, folder: str, outcome: Outcome) -> set[str]:
        came = set()
        for name, content in skeletons(archive.file):
            place = f"{folder}/{name}"
            part = Part(self.sums.root / place)
            part.file.parent.mkdir(parents=True, exist_ok=True)
            part.file.write_bytes(content)
            came.add(place)
            try:
                self._settle(part, place)
                outcome.fetched.append(place)
            except MismatchError as fault:
                outcome.faults.append(fault)
        return came

    def _download(self, url: str, target: Path) -> Part:
        part = Part(target)
        download(self.client, url, part, self.patience, self.follow(target.name))
        return part

    def _settle(self, part: Part, place: str) -> None:
        """Give the whole file its name if it holds what it should.

        Whatever stood there unverified, and a file that failed, is set aside as ``.aside``.
        """
        target, wanted, got = self.sums.root / place, self.sums.wanted(place), digest(part.file)
        aside = target.with_name(f"{target.name}.aside")
        if target.exists() and not self.sums.verified(place):
            target.replace(aside)
        if wanted not in (None, got) and not self.accept_changed:
            part.move_to(aside)
            raise MismatchError(
                f"{target}: wanted SHA-256 {wanted}, got {got}; set aside as {aside.name}"
            )
        self.sums.record(place, got)
        part.move_to(target)


def fetch(source: Source, fetcher: Fetcher, base_url: str, parts: list[str]) -> Outcome:
    """Fetch the named parts of a source, or all, one file after another.

    A file that the server lacks, or that does not hold what it should, does not stop the rest.

    Raises
    ------
    CommandError
        If the server cannot be reached or keeps failing.
    """
    outcome = Outcome()
    for file in [file for part in parts or source.parts for file in source.files(part)]:
        url, place = f"{base_url.rstrip('/')}/{file}", f"{source.folder}/{file}"
        try:
            if file.endswith(".zip"):
                fetcher.fetch_archive(url, place.removesuffix(".zip"), outcome)
            else:
                fetcher.fetch_file(url, place, outcome)
        except (MissingError, MismatchError, ArchiveError) as fault:
            outcome.faults.append(fault)
    return outcome
