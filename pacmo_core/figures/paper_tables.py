"""Tables 1 and 2 of the PaCMO paper, with our rows beside them.

As printed in Rahman et al. (2022), *PaCMO: Partner Dependent Human Motion Generation in Dyadic
Human Activity using Neural Operators*, arXiv 2211.16210.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from pacmo_core.figures.tables import Entry, Line, Rows, Table, make_entry
from pacmo_core.metrics.catalogue import METRICS, PUBLISHED_COLUMNS


@dataclass(frozen=True)
class PaperTable:
    """One table of the paper: by row, what is printed in the columns of ``PUBLISHED_COLUMNS``."""

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

LABELS = {"real": "Real Motion", "pacmo": "PaCMO", "gru": "GRU baseline"}
# Our rows that stand under a row of the paper, and what each is called there.
OUR_ROWS = {
    "real": {"real": "here: another draw, not the same set"},
    "pacmo": {"pacmo": "here", "pacmo_paper": "here, in the paper's plain form"},
    "gru": {"gru": "here"},
}

CAVEATS = (
    "F²ID and diversity are of features, and the paper's auto-encoder was never released: these "
    "columns compare rows of one table, not the paper with us.",
    "The paper's real motion and PaCMO, 0.001 and 0.002 in F²ID, are closer together than two "
    "draws of 1,000 from one law are likely to be: they cannot be told apart.",
    "MMD as published is biased: for two sets of n it is at least 2/n whatever their laws, "
    "0.002 for n = 1,000; 0 is a set against itself. Our real motion is a second draw.",
    "APE 0.03 m and AVE 0.23 m² on NTU RGB+D 120 contradict each other for motion in metres: so "
    "small an error of position would want roots that wander by some 3.8 m.",
    "Here n reactions are drawn with replacement, five times, as in the paper; small figures are "
    "the smallest and largest repeat, of APE and AVE the interval over clips.",
)


def side_by_side(paper: PaperTable, ours: Rows) -> Table:
    """Lay out a table of the paper with our rows under the paper's.

    Parameters
    ----------
    paper : the paper's
    ours : row to metric to cell; rows that we do not have are left out
    """
    lines = []
    for row, printed in paper.rows.items():
        texts = tuple(Entry(text.replace("-", "−"), "", "", "") for text in printed)
        lines.append(Line(LABELS[row], "the paper", is_model=False, entries=texts))
        for name, called in OUR_ROWS[row].items():
            if name in ours:
                cells = tuple(make_entry(ours[name].get(c, {}), "") for c in PUBLISHED_COLUMNS)
                lines.append(Line("", called, is_model=True, entries=cells))
    return Table(tuple(METRICS[column] for column in PUBLISHED_COLUMNS), tuple(lines))


def difference_note(paper: PaperTable, dataset: str) -> str:
    """Say what the data sets mean for a reader of the table."""
    if dataset == paper.dataset:
        return f"Both of {paper.name}, on other splits and features."
    return (
        f"The paper's figures are of {paper.name}, ours of {dataset}: another data set. The order "
        "of rows may be compared, the figures may not."
    )
