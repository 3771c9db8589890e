"""Tables 1 and 2 of the PaCMO paper, with our rows beside them.

As printed in Rahman et al. (2022), *PaCMO: Partner Dependent Human Motion Generation in Dyadic
Human Activity using Neural Operators*, arXiv 2211.16210.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from pacmo_core.figures.numbers import format_printed
from pacmo_core.figures.tables import Entry, Line, Rows, Table, make_entry
from pacmo_core.metrics.catalogue import METRICS, PUBLISHED_COLUMNS


@dataclass(frozen=True)
class PaperTable:
    """One table of the paper: printed values by row, in the columns of ``PUBLISHED_COLUMNS``."""

    number: int
    dataset: str
    name: str
    rows: Mapping[str, tuple[str, ...]]


PAPER_TABLES = (
    PaperTable(
        1,
        "ntu",
        "NTU RGB+D 120",
        {
            "real": ("0.001", "1.90", "0", "0", "0", "0"),
            "pacmo": ("0.002", "1.91", "5.8e-3", "3.8e-3", "0.03", "0.23"),
            "gru": ("0.351", "1.92", "7.4e-3", "4.4e-3", "0.05", "0.35"),
        },
    ),
    PaperTable(
        2,
        "duetdance",
        "DuetDance",
        {
            "real": ("1.6e-4", "0.261", "0", "0", "0", "0"),
            "pacmo": ("4.0e-4", "0.264", "6.7e-3", "6.67e-3", "0.01", "0.01"),
            "gru": ("494.9e-4", "0.190", "23.36e-3", "23.35e-3", "0.04", "0.08"),
        },
    ),
)

LABELS = {"real": "Real motion", "pacmo": "PaCMO", "gru": "GRU"}
# Our rows below a row of the paper, with what is particular about them.
OUR_ROWS = {
    "real": {"real": "a second sample, not the same set"},
    "pacmo": {"pacmo": "", "pacmo_paper": "as published, without additions"},
    "gru": {"gru": ""},
}
THE_PAPER, OURS = "the paper", "ours"

CAVEATS = (
    "F²ID and diversity depend on features, and the paper's auto-encoder was never released: these "
    "columns compare rows within the paper or within this report, not between them.",
    "The paper's real motion and PaCMO, 0.001 and 0.002 in F²ID, differ by less than two samples "
    "of 1,000 from one distribution typically do: the difference is not significant.",
    "MMD as published is biased: for two sets of n it is at least 2/n for any distributions, "
    "0.002 for n = 1,000; 0 is a set compared with itself. Our real motion is a second sample.",
    "APE 0.03 m and AVE 0.23 m² on NTU RGB+D 120 are inconsistent for motion in metres: such a "
    "variance with so small a position error requires root displacements of about 3.8 m.",
    "Here n reactions are sampled with replacement, five times, as in the paper; the small numbers "
    "are the smallest and largest repeat, of APE and AVE the interval over people.",
)


def side_by_side(paper: PaperTable, ours: Rows) -> Table:
    """Return a table of the paper with our rows below those of the paper.

    Parameters
    ----------
    paper : table of the paper
    ours : cells by row and metric; missing rows are omitted
    """
    lines = []
    for row, printed in paper.rows.items():
        texts = tuple(Entry(format_printed(text), "", "", "") for text in printed)
        lines.append(Line(f"{LABELS[row]}, {THE_PAPER}", "", is_model=False, entries=texts))
        for name, meaning in OUR_ROWS[row].items():
            if name in ours:
                cells = tuple(make_entry(ours[name].get(c, {}), "") for c in PUBLISHED_COLUMNS)
                label = f"{LABELS[row]}, {OURS}"
                lines.append(Line(label, meaning, is_model=True, entries=cells))
    return Table(tuple(METRICS[column] for column in PUBLISHED_COLUMNS), tuple(lines))


def difference_note(paper: PaperTable, dataset: str) -> str:
    """Return a note on what can be compared in the table."""
    if dataset == paper.dataset:
        return f"Both on {paper.name}, with different splits and features."
    return (
        f"The paper's values are for {paper.name}, ours for {dataset}. The order of rows can be "
        "compared, the values cannot."
    )
