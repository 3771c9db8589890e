"""Truth: the paper's Tables 1 and 2, and a few differences judged by eye."""

import pytest

from pacmo_core.figures.paper_tables import PAPER_TABLES, difference_note, side_by_side
from pacmo_core.figures.tables import difference_table, insensitive_metrics, sensitivity_table
from pacmo_core.metrics.catalogue import PUBLISHED_COLUMNS
from tests.figures.samples import cell

OURS = {
    row: {column: cell(0.5) for column in PUBLISHED_COLUMNS}
    for row in ("real", "pacmo", "pacmo_paper", "gru", "oracle")
}


def texts(table, label, meaning):
    (line,) = [li for li in table.lines if (li.label, li.meaning) == (label, meaning)]
    return [entry.value for entry in line.entries]


def test_the_papers_figures_are_shown_as_printed_under_their_columns():
    one, two = (side_by_side(paper, OURS) for paper in PAPER_TABLES)
    columns = [metric.label for metric in one.metrics]
    assert columns == ["F²ID", "Diversity", "MMD-A", "MMD-S", "APE", "AVE"]
    assert texts(one, "PaCMO, the paper", "") == [
        "0.002",
        "1.91",
        "0.0058",
        "0.0038",
        "0.03",
        "0.23",
    ]
    assert texts(two, "GRU, the paper", "")[0] == "0.04949"


def test_ours_stand_under_the_papers_and_only_what_there_is():
    def rows(ours):
        return [(line.label, line.meaning) for line in side_by_side(PAPER_TABLES[0], ours).lines]

    assert [label for label, _ in rows(OURS)] == [
        *("Real motion, the paper", "Real motion, ours", "PaCMO, the paper", "PaCMO, ours"),
        *("PaCMO, ours", "GRU, the paper", "GRU, ours"),
    ]
    few = {row: cells for row, cells in OURS.items() if row != "pacmo_paper"}
    assert len(rows(few)) == len(rows(OURS)) - 1
    assert ("PaCMO, ours", "as published, without additions") in rows(OURS)
    assert all(label.endswith((", the paper", ", ours")) for label, _ in rows(OURS))


def test_another_dataset_is_named():
    assert "ours for sbu" in difference_note(PAPER_TABLES[0], "sbu")
    assert "cannot" not in difference_note(PAPER_TABLES[1], "duetdance")


@pytest.mark.parametrize(
    ("metric", "mean", "marked"),
    [("f2id", -1.0, True), ("f2id", 1.0, False), ("f2id", -0.005, False), ("matching", 1.0, True),
     ("matching", -1.0, False), ("diversity", -1.0, False)],
)  # fmt: skip
def test_a_difference_is_marked_where_the_first_is_better_for_certain(metric, mean, marked):
    table = difference_table({"pacmo_minus_gru": {metric: cell(mean)}})
    assert table.metrics[0].label == "PaCMO − GRU"
    assert (table.lines[0].entries[0].mark == "best") == marked


def test_metrics_that_do_not_see_the_partner_are_named():
    seen = {
        "f2id_excess": {**cell(-1), "sensitive": True},
        "mmd_a": {**cell(0), "sensitive": False},
        "diversity_l2": {**cell(0), "sensitive": False},  # has no label, and is in no table
    }
    assert insensitive_metrics(seen) == ["MMD-A"]
    table = sensitivity_table({"any_action": seen}, {"any_action": "over all"})
    assert [line.entries[0].mark for line in table.lines] == ["best", ""]
    assert table.metrics[0].label == "over all"


def test_each_row_says_whose_it_is_where_its_column_heads_are_out_of_sight():
    for paper in PAPER_TABLES:
        labels = [line.label for line in side_by_side(paper, OURS).lines]
        assert all(label.endswith((", the paper", ", ours")) for label in labels), labels
