"""The code blocks of the documentation, and the commands in them."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class Block:
    """A block of code: its language, its text, and the file of ours named in the line before."""

    language: str
    text: str
    file: str


def blocks(page: Path) -> list[Block]:
    """Read a page."""
    text = page.read_text(encoding="utf-8")
    found = []
    for match in _BLOCK.finditer(text):
        before = text[: match.start()].rstrip().rpartition("\n\n")[2]
        named = re.search(r"`((?:stages|experiments)/\w+\.\w+|(?:params|dvc)\.yaml)`", before)
        found.append(Block(match[1], match[2], named[1] if named else ""))
    return found


def commands(page: Path, language: str | None = None) -> Iterator[list[str]]:
    """Read the commands, ``./run`` left out; of one language or of all that are no other."""
    for block in blocks(page):
        if block.language == language or (language is None and block.language in ("", "sh")):
            for line in re.findall(r"^(?:\./run|pacmo) .+", block.text, re.MULTILINE):
                # Not by shlex, which begins a comment in the midst of a name.
                words = shlex.split(re.sub(r"\s#\s.*", "", line))
                yield words[1:] if words[:1] == ["./run"] else words
