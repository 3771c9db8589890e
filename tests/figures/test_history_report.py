"""Truth: the page that goes in stays as it was around what is set into it; HTML's escaping."""

import dataclasses
import re

import pytest

from pacmo_core.figures import render_report
from pacmo_core.figures.history import (
    LINKS,
    SECTIONS,
    DecisionRow,
    Measurement,
    ReportContext,
    StageRun,
    StudyTable,
    add_history,
)
from tests.figures.samples import cell, report
from tests.figures.test_report import HOSTILE, Page

NUMBERS = ("0.800 (0.700 to 0.900), 80 of 100", "0.75", "0.81", "0.75")


def beside(name: str) -> ReportContext:
    runs = tuple(
        Measurement(k, "2026-01-01", name, name, "ab" * 32, {"f2id": cell(k / 9), "ape": cell(0.1)})
        for k in (1, 2)
    )
    row = DecisionRow(1, "2026-01-01", name, "held", (name,), "ab" * 6, 0)
    stage = StageRun(name, f"python {name}", ((name, "12"),), ((name, "34"),))
    study = StudyTable(((name, *NUMBERS),), (name,))
    return ReportContext(study, runs, (row,), (f"git checkout {name}",), (stage,))


def test_around_what_is_set_in_the_page_is_the_same() -> None:
    page = render_report(report())
    whole = add_history(page, beside("x"))
    start, rest = page.split(LINKS)
    middle, end = rest.split(SECTIONS)
    assert whole.startswith(start)
    assert middle in whole
    assert whole.endswith(end)
    assert add_history(page, beside("x")) == whole


def test_history_study_and_commands_are_shown() -> None:
    page = Page(add_history(render_report(report()), beside("x")))
    assert {"study", "history", "commands"} <= {v for k, v in page.attributes if k == "id"}
    assert set(NUMBERS) <= set(page.texts)
    assert {"0.111", "0.222", "python x", "git checkout x"} <= set(page.texts)


def test_names_with_markup_are_shown_and_make_no_tag() -> None:
    page = render_report(report())
    plain, hostile = (Page(add_history(page, beside(name))) for name in ("a", HOSTILE))
    assert hostile.tags == plain.tags
    assert HOSTILE in hostile.texts


def test_where_nothing_is_known_nothing_is_said() -> None:
    whole = add_history(render_report(report()), ReportContext())
    assert not any(f'id="{name}"' in whole for name in ("study", "history", "commands"))


def test_a_mark_in_a_name_is_no_place_to_set_things_in() -> None:
    add_history(render_report(report(f"{LINKS}{SECTIONS}")), beside(SECTIONS))


def test_a_page_without_a_place_is_refused() -> None:
    with pytest.raises(ValueError, match="got 0"):
        add_history("<p>no report</p>", ReportContext())


def test_one_run_alone_is_no_curve() -> None:
    once = dataclasses.replace(beside("x"), runs=beside("x").runs[:1])
    assert "metrics of all runs" not in add_history(render_report(report()), once)


def test_the_chart_of_a_metric_holds_the_intervals_of_its_runs() -> None:
    runs = tuple(
        Measurement(k, "2026-01-01", "x", "x", "ab" * 32, {"f2id": cell(0.5 + k / 100, 2.0)})
        for k in (1, 2, 3, 4)
    )
    page = add_history(render_report(report()), ReportContext(runs=runs))
    history = page[page.index('id="history"') :]
    chart = history[: history.index("</svg>")]
    assert chart.count("<circle") == 4
    assert re.findall(r'class="y"[^>]*>(.*?)<', chart) == ["0", "2"]
