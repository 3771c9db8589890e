"""Reference: the files to which the table "Where is what" of docs/architecture.md leads."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
REQUIRED = (
    *("gradient penalty", "Fréchet distance", "ADMM", "KL divergence", "M-GCN", "random body"),
    *("promotion", "new dataset", "n_epochs", "best epoch"),
)
# Without the further pages of results, which define nothing: results.md leads to them.
SEARCHED = (
    *("pacmo_core/*.py", "stages/*.py", "flows/*.py", "params.yaml", "dvc.yaml", "docs/*.md"),
    ":!docs/results_*.md",
)
MAX_HOPS = 4
MAX_FILES = 20  # that a search finds
LINK = re.compile(r"\[[^\]]+\]\(([^)]+)\) `([^`]+)`")


def rows() -> list[tuple[str, str, list[tuple[str, str]]]]:
    """Read the table: question, term, links with the words in their files."""
    section = PAGE.read_text().partition("## Where is what")[2].partition("\n## ")[0]
    cells = [line.strip("|").split("|") for line in section.splitlines() if line.startswith("| ")]
    return [(q.strip(), term.strip(), LINK.findall(where)) for q, term, where in cells[1:]]


ROWS = rows()
IDS = [term for _, term, _ in ROWS]


def search(term: str) -> list[Path]:
    """List the files of the product that contain a term, whatever its case and its spaces."""
    listed = subprocess.run(
        ["git", "ls-files", *SEARCHED], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    pattern = re.compile(r"[\s_-]*".join(map(re.escape, term.split())), re.IGNORECASE)
    files = [ROOT / name for name in listed]
    return [file for file in files if file != PAGE and pattern.search(file.read_text())]


def test_the_readme_links_the_table_and_the_table_has_every_question() -> None:
    assert "(docs/architecture.md#where-is-what)" in (ROOT / "README.md").read_text()
    assert set(REQUIRED) <= set(IDS)


@pytest.mark.parametrize(("links"), [links for _, _, links in ROWS], ids=IDS)
def test_the_links_lead_to_the_answer(links: list[tuple[str, str]]) -> None:
    assert 1 <= len(links) < MAX_HOPS  # one more leads from the README to the page
    for target, symbol in links:
        assert symbol in (PAGE.parent / target).read_text(), f"{target} has no {symbol}"
    (symbol,) = (symbol for _, symbol in links[-1:])
    assert not symbol.startswith(("def ", "class ")) or links[-1][0].endswith(".py")


@pytest.mark.parametrize(("term", "links"), [row[1:] for row in ROWS], ids=IDS)
def test_a_search_for_the_term_finds_it_among_few_files(
    term: str, links: list[tuple[str, str]]
) -> None:
    found = search(term)
    assert (PAGE.parent / links[-1][0]).resolve() in found
    assert len(found) <= MAX_FILES
