"""Random inboxes for ``benchmarks.robustness``: trees of files, through the real intake.

Captures of a random format lie among what a careless or hostile sender leaves: long, odd and
clashing names, pipes, sockets, links that dangle, loop or lead out, folders where files are wanted,
half-written files. Whatever it is, the night goes on, a good capture beside it is taken, and no
file is lost: its content lies in the inbox, among the captures or in quarantine, with a reason.
"""

import hashlib
import json
import logging
import os
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest import mock

from ruamel.yaml import YAML

from benchmarks._fuzz_texts import TEXTS, Grammar
from flows import inbox
from flows.inbox import IntakeResult, take_captures
from pacmo_core.data.limits import walk_files
from pacmo_core.formats.registry import DEFAULT_SETTINGS
from pacmo_core.project.workspace import INBOX, QUARANTINE, REASON_FILE
from tests.flows.projects import PARAMS, capture

RAW = Path("data/captures/lab")
GOOD = Path("good/skeleton_pos.txt")
FOLDERS = (
    *("a", "b", "a b", "a-u20-b", "s01s02", "s/01", "s_01", ".hidden", "x" * 120, "y" * 250),
    *("\x1b[31m", "line\nbreak", "-rf", "$(id)", "%2e%2e", "caf\udce9", "é" * 40, "#", "~", "18"),
    *("deep/" * 20 + "d", "skeleton_pos.txt", "a.bvh", "dvc.yaml", "tmp.dvc", "captures.csv"),
)
STRAY = (
    *(
        "dvc.yaml",
        ".dvcignore",
        "captures.csv",
        "readme.txt",
        "x.bvh",
        "x_A.bvh",
        "skeleton_pos.txt",
    ),
    *("18_01.amc", "S001C001P001R001A001.skeleton", "salsa.mat", "x.npz", "..npz", ".csv", ".1.2"),
    *("reason.json", "skeleton_A.txt", "mocap_cleaned.tsv", "caf\udce9.csv", "Z" * 250 + ".csv"),
)


def unix_socket(path: Path) -> None:
    """Make a socket."""
    here = Path.cwd()
    os.chdir(path.parent)  # the path of a socket has at most 107 bytes
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path.name)
    finally:
        os.chdir(here)


def _deep(path: Path) -> None:
    here = Path.cwd()
    path.mkdir()
    os.chdir(path)
    for _ in range(20):
        Path("z" * 240).mkdir()
        os.chdir("z" * 240)
    os.chdir(here)


IRREGULAR: dict[str, Callable[[Path], object]] = {
    "a pipe": os.mkfifo,
    "a socket": unix_socket,
    "a link to nothing": lambda path: path.symlink_to("nothing"),
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to a device": lambda path: path.symlink_to("/dev/zero"),
    "a link out of the folder": lambda path: path.symlink_to("/etc/hostname"),
    "a link to its folder": lambda path: path.symlink_to(".", target_is_directory=True),
}
_ODD: tuple[Callable[[Path], object], ...] = (
    *IRREGULAR.values(),
    lambda path: path.mkdir(),
    lambda path: path.symlink_to("../good/skeleton_pos.txt"),
    lambda path: path.touch(),
    lambda path: path.write_bytes(os.urandom(40)),
    _deep,
)


def write_inbox(grammar: Grammar, folder: Path) -> None:
    """Write a random inbox, and captures that are there already."""
    names = ("sbu",) * len(TEXTS) + tuple(TEXTS)
    form = grammar.pick(names)
    (folder / "format").write_text(form)
    for place in (folder / INBOX, folder / RAW):
        place.mkdir(parents=True)
        for _ in range(grammar.integer(0, 4)):
            with suppress(OSError):  # two of one name, or a file where a folder is wanted
                _capture(grammar, form, place / grammar.pick(FOLDERS))
    for _ in range(grammar.integer(0, 4)):
        with suppress(OSError):
            _stray(grammar, folder / INBOX)
    if form == "sbu":
        good = folder / INBOX / GOOD
        good.parent.mkdir()
        good.write_text(capture(grammar.integer(0, 10**6)))


def _capture(grammar: Grammar, form: str, folder: Path) -> None:
    folder.mkdir(parents=True)  # a new one: to write into a pipe would wait for its reader
    if form == "sbu" and grammar.random.random() < 0.6:
        (folder / GOOD.name).write_text(capture(grammar.integer(0, 3)))
    else:
        TEXTS[form](grammar, folder)
    files = sorted(walk_files(folder))
    if grammar.random.random() < 0.3:  # half written, or something else in its place
        file = files[grammar.integer(0, len(files))]
        content = file.read_bytes()
        if grammar.integer(0, 2):
            file.write_bytes(content[: grammar.integer(0, len(content) + 1)])
        else:
            file.unlink()
            _ODD[grammar.integer(0, len(_ODD))](file)


def _stray(grammar: Grammar, root: Path) -> None:
    folder = root / grammar.pick((*FOLDERS, ".", "."))
    folder.mkdir(parents=True, exist_ok=True)
    _ODD[grammar.integer(0, len(_ODD))](folder / grammar.pick((*STRAY, *FOLDERS[:6])))


def write_irregular(make: Callable[[Path], object], folder: Path, _: Path) -> None:
    """Write an inbox whose one capture is no regular file."""
    (folder / "format").write_text("sbu")
    (folder / RAW).mkdir(parents=True)
    (folder / INBOX / "odd").mkdir(parents=True)
    make(folder / INBOX / "odd" / GOOD.name)


class RefusedError(ValueError):
    """The intake has quarantined all that it has looked at, or has found nothing."""


def read_inbox(folder: Path) -> None:
    """Take everything in, twice, and check what became of it.

    Raises
    ------
    RefusedError
        If no capture was accepted, with the first reason.
    RuntimeError
        If a file is lost or changed, a reason is missing, or a later night finds something to do.
    """
    with _project(folder):
        sent, present, links = _contents(INBOX), _contents(RAW), _links(RAW)
        result = take_captures(settle_s=0.0)
        _check(result, sent, present)
        if _links(RAW) - links:  # one that leads to nothing may be replaced by a capture
            raise RuntimeError("a link was taken as it is")
        if any(vars(later) != vars(result) | {"accepted": (), "quarantined": {}}
               for later in [take_captures(settle_s=0.0)]):  # fmt: skip
            raise RuntimeError("a second night finds something to do")
        subprocess.run(["rm", "-rf", INBOX], check=True)  # Python's removal fails on deep folders
    if not set(result.accepted) - {GOOD.parent.name}:
        raise RefusedError(next(iter(result.quarantined.values()), "no capture"))


@contextmanager
def _project(folder: Path) -> Iterator[None]:
    """Be in a project of the inbox's format; DVC is not asked, which takes most of a second."""
    params = YAML(typ="safe").load(PARAMS.format(f2id=1, min_new_captures=1))
    form = (folder / "format").read_text()
    settings = {**DEFAULT_SETTINGS[form], **({"unit": 1.0, "up": "y"} if form == "bvh" else {})}
    params["ingest"] |= {"format": form, "settings": settings}
    YAML().dump(params, folder / "params.yaml")
    here = Path.cwd()
    logging.getLogger("pacmo").addHandler(logging.NullHandler())
    logging.getLogger("pacmo").propagate = False
    os.chdir(folder)
    try:
        with mock.patch.object(inbox, "_is_stage_output", return_value=False):
            yield
    finally:
        os.chdir(here)


def _contents(root: Path) -> dict[Path, str]:
    """Return the hashes of the regular files below a folder, by relative path."""
    files = [f for f in walk_files(root) if f.is_file() and not f.is_symlink()]
    return {f.relative_to(root): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


def _links(root: Path) -> set[Path]:
    return {file for file in walk_files(root) if file.is_symlink()}


def _check(result: IntakeResult, sent: dict[Path, str], present: dict[Path, str]) -> None:
    left, taken = _contents(INBOX), _contents(RAW)
    if {path: taken.get(path) for path in present} != present:
        raise RuntimeError("a capture that was there has changed")
    kept = {*taken.values(), *_contents(QUARANTINE).values()}
    lost = [p for p, digest in sent.items() if left.get(p) != digest and digest not in kept]
    if lost:
        raise RuntimeError(f"lost: {lost}")
    if GOOD in sent and sent[GOOD] not in taken.values():
        raise RuntimeError(f"the good capture was refused: {result.quarantined}")
    reasons = [json.loads(p.read_text())["reason"] for p in QUARANTINE.glob(f"*/{REASON_FILE}")]
    if not set(result.quarantined.values()) <= set(reasons):  # two may have one name
        raise RuntimeError(f"{reasons} are written of {result.quarantined}")
    texts = [*reasons, *result.quarantined, *result.accepted, *result.waiting]
    if not all(text.isprintable() for text in texts):
        raise RuntimeError(f"not printable: {texts}")
