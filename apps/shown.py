"""Clips named on the command line: of the store, or captures of any format that is read."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.names import ReactionName, is_reaction
from pacmo_core.figures.scenes import Scene
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.registry import DEFAULT_SETTINGS, ONE_PERSON_FORMATS, format_of, open_format
from pacmo_core.project.workspace import MOTIONS, CommandError
from pacmo_core.store.motions import motion_file, read_motion
from pacmo_core.store.tables import ACCEPTED, FAILED, SOURCES, VARIATIONS, read_variations

STORE = Path("data/clips")


def read_scene(word: str, form: str | None, settings: Mapping[str, Any]) -> Scene:
    """Read what a word of the command line names.

    Parameters
    ----------
    word : ``NAME`` of a clip in ``data/clips``, ``STORE:NAME`` of one in another folder or file
        (a variation's name is ``CLIP~NAME``), ``FILE`` of a capture, or ``FILE+FILE`` of two people
    form : the captures' format, None to go by their endings
    settings : what differs from the format's published facts

    Raises
    ------
    CommandError
        If the word names nothing, or what it names needs more to be said.
    FormatError, StoreError, KeyError, ValueError
        As the readers say.
    """
    store, colon, name = word.partition(":")
    if colon and Path(store).exists():
        return _stored(Path(store), name)
    files = [Path(part) for part in word.split("+")]
    if all(file.is_file() for file in files):
        return _captured(files, form, settings)
    if (STORE / MOTIONS).exists() and len(files) == 1:
        return _stored(STORE, word)
    raise CommandError(
        f"{word}: no such file, and no {STORE / MOTIONS} here to hold a clip of that name; "
        "a clip of another folder is FOLDER:NAME"
    )


def _stored(store: Path, name: str) -> Scene:
    """Show a clip of the store; a reaction keeps the colour of the person who reacts."""
    if not name:
        raise CommandError(f"{store}: wanted the name of a clip after the colon (pacmo clips)")
    found = read_motion(_file_of(store, name) if store.is_dir() else store, name)
    # A reaction is told from others to the same partner by its folder, as pacmo/1.
    folder = "/".join(store.parts[-2:]) if is_reaction(name) and store.is_dir() else ""
    label = f"{folder} · {name}" if folder else name
    swap = is_reaction(name) and ReactionName.parse(name).direction == "a"
    return Scene.of(label, found.swapped() if swap else found)


def _file_of(folder: Path, name: str) -> Path:
    """Say which file of a folder holds a clip; in one of variations each source has its own."""
    facts = folder / VARIATIONS
    if not facts.exists():
        return folder / MOTIONS
    rows = [row for row in read_variations(facts) if name in (row.variation, row.clip)]
    if not rows:
        raise CommandError(f"{facts}: no variation {name}, and no clip of that name was varied")
    row = rows[0]
    if name == row.clip:
        return motion_file(folder / SOURCES, row.clip)
    if not row.measurements:
        raise CommandError(f"{facts}: {name} was not made: {row.reason}")
    return motion_file(folder / (ACCEPTED if row.accepted else FAILED), row.clip)


def _captured(files: list[Path], form: str | None, settings: Mapping[str, Any]) -> Scene:
    if any(file.suffix.lower() == ".parquet" for file in files):
        raise CommandError(f"{files[0]}: name the clip, {files[0]}:NAME")
    form = form or format_of(files[0])
    if form not in DEFAULT_SETTINGS:
        raise CommandError(f"no format {form!r}; there are {', '.join(DEFAULT_SETTINGS)}")
    pairs = form in ONE_PERSON_FORMATS
    if len(files) > (2 if pairs else 1):
        raise CommandError(f"{files[0]}: wanted {'at most two files' if pairs else 'one file'}")
    opened = open_format(form, {**DEFAULT_SETTINGS[form], **_rates(files, form, settings)})
    # Every format of one person a file pairs people; a person paired with himself is one.
    both = (files[0], files[-1]) if pairs else (files[0],)
    seen = opened.read(RawSequence(files[0].stem, both)).interaction
    label = " + ".join(file.stem for file in files)
    alone = pairs and len(files) == 1
    return _one(label, seen) if alone else Scene.of(label, seen)


def _one(label: str, seen: Interaction) -> Scene:
    return Scene(label, seen.skeleton, seen.times, (seen.person_a,))


def _rates(files: list[Path], form: str, settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """CMU's rates go by subject, which is the first word of a file's name."""
    if form != "cmu" or "fps" not in settings:
        return settings
    return {**settings, "fps": {file.stem.partition("_")[0]: settings["fps"] for file in files}}
