"""Truth: figures written down here, the worst of which is told by eye; the page's own HTML."""

import json
import re
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacmo_core.augmentation.filter import VariationLimits
from pacmo_core.figures import Report, render_report
from pacmo_core.figures.report import Section
from pacmo_core.figures.variations import (
    DECIMALS,
    MEASURES,
    TABLE_MEASURES,
    WORST_BY,
    ShownVariation,
    limit_text,
    limits_table,
    measurement_lines,
    played_variation,
    variation_label,
    variation_table,
    worst_by_measure,
)
from pacmo_core.metrics.catalogue import HIGHER
from tests.figures.samples import interaction, report

FIGURES = {
    "near_distance_error": 0.0057,
    "near_distance_error_naive": 0.205,
    "contacts_kept": 0.99,
    "contacts_kept_with_slack": 1.0,
    "knee_change_p95": 3.2,
    "elbow_change_p95": 17.0,
    "shoulder_change_p95": 8.0,
    "seam_ratio": 1.1,
    "spine_change_p95": 4.0,
    "pelvis_height_error": 0.013,
    "support_height_error": 0.004,
    "spine_bend": 6.5,
    "trunk_change": 0.25,
    "below_floor": 0.001,
    "added_foot_skate": -0.0031,
    "capsule_penetration": 0.004,
    "peak_acceleration_ratio": 1.21,
    "knee_flips": 0.0,
    "elbow_flips": 0.0,
}
FAULTLESS = {
    name: (0.0 if m.perfect is None else m.perfect / m.factor) for name, m in MEASURES.items()
}
SHOWN = (
    ShownVariation("b: child", FIGURES, interaction(3), ("knee_change_p95",), ["knee_change_p95"]),
    ShownVariation("both bodies sampled, r0001", FIGURES, interaction(4), ("contacts_kept",)),
)


def page() -> tuple[Report, str]:
    clip = played_variation("salsa<1>", interaction(2), SHOWN, {"knee_change_p95": 3.0})
    whole = replace(report(n_clips=2), gallery=(clip,))
    return whole, render_report(whole)


def test_measurements_have_a_line_each_in_practical_units_beside_limit_and_person() -> None:
    worse = {"elbow_change_p95": "b", "knee_change_p95": "a", "below_floor": "a"}
    figures = FIGURES | {"below_floor": 1e-6}
    lines = measurement_lines(figures, {"elbow_change_p95": 60.0, "contacts_kept": 0.8}, worse)
    assert [" ".join(line.split()) for line in lines] == [
        "near distances 5.7 mm 205.0 mm if only scaled",
        "contacts kept 99.0 % wanted at least 80.0 %",
        "knees 3.2° person a",
        "elbows 17.0° wanted at most 60.0°, person b",
        "spine 4.0°",
        "spine, one joint 6.5°",
        "pelvis height 1.30 cm",
        "feet's height 0.40 cm",
        "below the floor 0 cm",
        "added foot skate −0.31 cm/s",
        "penetration 0.40 cm",
        "peak acceleration 1.21×",
        "jumps 1.10×",
    ]


def test_a_measurement_that_is_absent_has_no_line() -> None:
    figures = {name: value for name, value in FIGURES.items() if name != "contacts_kept"}
    lines = measurement_lines(figures, {}, {})
    assert len(lines) == len(measurement_lines(FIGURES, {}, {})) - 1
    assert not [line for line in lines if "contacts" in line]


@given(st.sampled_from(sorted(MEASURES)), st.floats(-1e4, 1e4))
def test_a_measurement_has_the_decimals_of_its_unit(name: str, value: float) -> None:
    measure = MEASURES[name]
    number = measure.number(value).replace(",", "").replace("−", "-")
    assert re.fullmatch(r"0|-?\d+\.\d{1,2}", number)
    wanted = measure.factor * value
    assert abs(float(number) - wanted) <= 0.5001 * 10 ** -DECIMALS[measure.unit]
    assert number == "0" or float(number) != 0


def test_the_gallery_plays_after_the_clips_source_first_and_says_what_is_worst() -> None:
    _, html = page()
    assert html.count('class="player"') == 3
    at = html.index('id="variations"')
    gallery = html[at : html.index("</section>", at)]
    assert 'data-clip="2"' in gallery
    captions = re.findall(r"<figcaption>.*?<span>(.*?)</span>", gallery)
    assert captions == ["Source", "b: child", "both bodies sampled, r0001"]
    assert "<b>b: child</b> is the worst by knees (3.2°); left out of training for knees" in gallery
    assert "is the worst by contacts kept (99.0 %)</li>" in gallery
    knees = re.search(r"<tr><th[^>]*>Knees.*?</tr>", gallery, re.DOTALL)
    assert knees and 'class="worst"' in knees[0] and ">3.0<" in knees[0]
    assert gallery.count('class="worst"') == 1
    assert "salsa&lt;1&gt;" in gallery
    (motions,) = re.findall(r'id="motions">(.*?)</script>', html)
    assert [len(scenes) for scenes in json.loads(motions)][-1] == 3


def test_a_page_without_variations_says_nothing_of_them() -> None:
    assert 'id="variations"' not in render_report(report())


def test_kinds_have_a_line_each_in_a_fixed_order() -> None:
    cells = {name: {"mean": value, "low": 0.0, "high": 1.0} for name, value in FIGURES.items()}
    table = variation_table({"single": cells, "uniform": cells})
    assert [line.label for line in table.lines] == ["One body scaled", "One bone"]
    assert len(table.metrics) == len(TABLE_MEASURES) == len(table.lines[0].entries)
    by_label = dict(zip([m.label for m in table.metrics], table.lines[0].entries, strict=True))
    assert (by_label["Near distances"].value, by_label["Pelvis height"].value) == ("5.70", "1.30")
    html = render_report(replace(report(), sections=(Section("Variations", table, ("counts",)),)))
    assert "Contacts kept" in html


def test_every_limit_and_every_measure_of_the_gallery_has_words() -> None:
    assert {field.name for field in fields(VariationLimits)} <= MEASURES.keys()
    assert set(WORST_BY) == {
        *("near_distance_error", "contacts_kept", "knee_change_p95", "elbow_change_p95"),
        *("spine_change_p95", "pelvis_height_error", "support_height_error", "below_floor"),
        *("added_foot_skate", "spine_bend"),
        *("capsule_penetration", "peak_acceleration_ratio", "knee_flips", "elbow_flips"),
    }


@pytest.mark.parametrize("measure", WORST_BY)
def test_the_worst_by_one_measure_alone_is_selected_by_it(measure: str) -> None:
    step = -0.1 if MEASURES[measure].better == HIGHER else 0.1
    rows = [
        (name, FAULTLESS | {measure: FAULTLESS[measure] + size * step})
        for name, size in (("a", 1), ("b", 3), ("c", 2))
    ]
    assert worst_by_measure(rows) == {"b": [measure]}


def test_a_variation_that_is_the_worst_by_several_is_selected_once() -> None:
    bad = FAULTLESS | {"knee_change_p95": 20.0, "below_floor": 0.02}
    other = FAULTLESS | {"knee_change_p95": 10.0, "contacts_kept": 0.5}
    assert worst_by_measure([("x", bad), ("y", other)]) == {
        "y": ["contacts_kept"],
        "x": ["knee_change_p95", "below_floor"],
    }


def test_without_a_fault_nothing_is_the_worst() -> None:
    assert worst_by_measure([("x", FAULTLESS), ("y", FAULTLESS)]) == {}
    assert worst_by_measure([]) == {}


@given(st.lists(st.floats(-1, 1) | st.just(float("nan")), min_size=1, max_size=6))
def test_the_selected_one_has_the_largest_finite_value(values: list[float]) -> None:
    rows = [(f"v{k}", {"below_floor": value}) for k, value in enumerate(values)]
    positive = [value for value in values if value > 0]
    selected = worst_by_measure(rows)
    assert len(selected) == bool(positive)
    for name in selected:
        assert dict(rows)[name]["below_floor"] == max(positive)


def test_names_of_variations_are_put_in_words() -> None:
    words = {
        "b-child": "b: child",
        "a-tall_adult": "a: tall adult",
        "a-left_forearm-1.20": "a: left forearm × 1.20",
        "b-uniform-0.80": "b: all bones × 0.80",
        "r0007": "both bodies sampled, r0007",
    }
    assert {name: variation_label(name) for name in words} == words


def test_a_limit_is_stated_in_the_unit_of_its_measurement() -> None:
    assert limit_text("knee_change_p95", 41.23, 30) == "knees 41.2°, wanted at most 30.0°"
    assert limit_text("contacts_kept", 0.7, 0.8) == "contacts kept 70.0 %, wanted at least 80.0 %"


def test_measurements_stand_beside_their_limits_and_those_beyond_are_marked() -> None:
    columns = [("0", FIGURES, ["elbow_change_p95"]), ("1", FAULTLESS, [])]
    table = limits_table(columns, {"elbow_change_p95": 10.0})
    assert [metric.label for metric in table.metrics] == ["0", "1", "Limit"]
    lines = {line.label: line.entries for line in table.lines}
    value, other, limit = lines["Elbows ↓ °"]
    assert (value.value, value.mark, limit.value) == ("17.0", "worst", "10.0")
    assert (other.value, other.mark) == ("0", "")
    value, _, limit = lines["Knees ↓ °"]
    assert (value.value, value.mark, limit.value, limit.reason) == ("3.2", "", "–", "no limit")
