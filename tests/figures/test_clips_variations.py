"""Truth: figures written down here; the page's own HTML."""

import json
import re
from dataclasses import replace

from pacmo_core.figures import Report, render_report
from pacmo_core.figures.clips import (
    MEASUREMENT_COLUMNS,
    measurement_summary,
    played_variation,
    variation_table,
)
from pacmo_core.figures.report import Section
from tests.figures.samples import interaction, report

FIGURES = {
    "near_distance_error": 0.0057,
    "near_distance_error_naive": 0.205,
    "far_distance_error": 0.01,
    "contacts_kept": 0.99,
    "contacts_kept_with_slack": 1.0,
    "knee_change_p95": 3.2,
    "elbow_change_p95": 17.0,
    "spine_change_p95": 4.0,
    "pelvis_height_error": 0.013,
    "trunk_change": 0.25,
    "below_floor": 0.001,
    "added_foot_skate": -0.0031,
    "capsule_penetration": 0.004,
    "peak_acceleration_ratio": 1.21,
    "elbow_flips": 0.0,
}


def page() -> tuple[Report, str]:
    shown = [("b-child (left out)", FIGURES, interaction(3)), ("r0001", FIGURES, interaction(4))]
    clip = played_variation("salsa<1>", interaction(2), shown)
    whole = replace(report(n_clips=2), gallery=(clip,))
    return whole, render_report(whole)


def test_measurements_are_summarised_in_practical_units() -> None:
    text = measurement_summary(FIGURES)
    for words in ("5.7 mm", "205 if only scaled", "99.0 %", "-0.31 cm/s", "0.4 cm", "elbows 17°"):
        assert words in text


def test_the_gallery_plays_after_the_clips_source_first() -> None:
    _, html = page()
    assert html.count('class="player"') == 3
    at = html.index('id="variations"')
    gallery = html[at : html.index("</section>", at)]
    assert 'data-clip="2"' in gallery
    captions = re.findall(r"<figcaption>.*?<span>(.*?)</span>", gallery)
    assert captions[0] == "source"
    assert captions[1].startswith("b-child (left out): near distances changed by 5.7 mm")
    assert "salsa&lt;1&gt;" in gallery
    (motions,) = re.findall(r'id="motions">(.*?)</script>', html)
    assert [len(scenes) for scenes in json.loads(motions)][-1] == 3


def test_a_page_without_variations_says_nothing_of_them() -> None:
    assert 'id="variations"' not in render_report(report())


def test_kinds_have_a_line_each_in_a_fixed_order() -> None:
    cells = {name: {"mean": value, "low": 0.0, "high": 1.0} for name, value in FIGURES.items()}
    table = variation_table({"single": cells, "uniform": cells})
    assert [line.label for line in table.lines] == ["One body scaled", "One bone"]
    assert len(table.metrics) == len(MEASUREMENT_COLUMNS) == len(table.lines[0].entries)
    html = render_report(replace(report(), sections=(Section("Variations", table, ("counts",)),)))
    assert "Contacts kept" in html
