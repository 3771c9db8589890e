"""Truth: a page is text; what may stand in it is HTML's rule for escaping and our own for URLs."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from pacmo_core.figures import Panel, PlayedClip, Report, render_report
from pacmo_core.figures.findings import Finding
from pacmo_core.figures.viewer import LIBRARY, player_scripts, read_asset, script_hash
from pacmo_core.metrics.catalogue import METRICS, ROWS
from tests.figures.samples import interaction, report

HOSTILE = '</script><script>alert(1)</script><img src=x onerror="alert(2)">\'"&<!--{{7*7}}'


class Page(HTMLParser):
    """The tags, attributes and texts of a page, and the data that it carries."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.texts: list[str] = []
        self.scripts: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep a tag and its attributes."""
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_data(self, data: str) -> None:
        """Keep a text, apart from what a script holds."""
        in_script = self.cdata_elem == "script"
        (self.scripts if in_script else self.texts).append(data.strip())


def test_a_name_with_markup_is_shown_and_makes_no_tag() -> None:
    plain, hostile = Page(render_report(report("a"))), Page(render_report(report(HOSTILE)))
    assert hostile.tags == plain.tags
    assert [name for name, _ in hostile.attributes] == [name for name, _ in plain.attributes]
    assert sum(text == HOSTILE for text in hostile.texts) > 5


def test_an_action_and_a_label_with_markup_are_shown_too() -> None:
    clip = PlayedClip("n", HOSTILE, (Panel(HOSTILE, interaction(1)),))
    page = Page(render_report(Report("t", "s", {}, report().data, {}, clips=(clip,))))
    assert "img" not in page.tags
    assert sum(text == HOSTILE for text in page.texts) == 2


def test_equal_reports_give_equal_bytes() -> None:
    assert render_report(report()).encode() == render_report(report()).encode()


def test_the_page_refers_to_nothing_outside_itself() -> None:
    # The library names XML's namespaces; what it asks for, a browser tells in test_player.
    html = render_report(report()).replace(read_asset(LIBRARY), "")
    references = [
        value
        for name, value in Page(html).attributes
        if name in {"src", "href", "action", "data", "srcset", "poster", "xlink:href", "style"}
    ]
    assert references
    assert all(re.match(r"#|data:,$", value) for value in references)
    assert not re.search(
        r"@import|url\(|https?:|[\"'(]//|\bfetch\b|XMLHttp|WebSocket|import\(", html
    )


def test_the_policy_names_the_only_scripts_that_may_run() -> None:
    page = Page(render_report(report()))
    (policy,) = (value for _, value in page.attributes if value.startswith("default-src 'none'"))
    assert "unsafe-eval" not in policy
    assert "unsafe-inline" not in policy.partition("script-src")[2]
    html = render_report(report())
    for script in player_scripts():
        assert f"<script>{script}</script>" in html
        assert f"'{script_hash(script)}'" in policy


def test_a_page_without_clips_lets_no_script_run() -> None:
    page = Page(render_report(Report("t", "s", {}, report().data, {})))
    assert page.tags.count("script") == 1
    assert any(value.endswith("script-src 'none'") for _, value in page.attributes)


def test_the_motions_travel_as_json_of_one_entry_a_clip() -> None:
    page = Page(render_report(report(n_clips=3)))
    motions = json.loads(page.scripts[0])
    assert [len(clip) for clip in motions] == [2, 2, 2]


def test_quarantine_is_counted_by_reason_and_listed_by_file() -> None:
    texts = Page(render_report(report())).texts
    reason = texts.index("wanted 91 values; got 90")
    assert "2" in texts[reason : reason + 3]
    assert {"b.txt", "c.txt", "9"} <= set(texts)


def test_a_missing_metric_is_a_dash_with_its_reason() -> None:
    texts = Page(render_report(report())).texts
    assert "–" in texts
    assert "no error of its own" in texts


def test_a_report_of_nothing_but_data_renders() -> None:
    html = render_report(Report("t", "s", {}, report().data, {}))
    assert 'id="clips"' not in html
    assert 'id="metrics"' not in html


def test_the_report_of_a_default_run_is_under_5_megabytes() -> None:
    panels = tuple(Panel(str(i), interaction(i, n_frames=90)) for i in range(4))
    clips = tuple(PlayedClip(str(i), "", panels) for i in range(8))
    assert len(render_report(Report("t", "s", {}, report().data, {}, clips=clips))) < 5_000_000


def test_a_clip_without_a_panel_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one panel"):
        PlayedClip("n", "", ())


def test_the_page_opens_with_what_was_found_then_clips_then_tables() -> None:
    findings = (Finding("PaCMO", "does not beat GRU."), Finding("GRU", "was not compared."))
    html = render_report(replace(report(), findings=findings, findings_note="what it rests on"))
    body = html[html.index("<body>") :]
    order = [
        *("<b>PaCMO</b> does not beat GRU.", "<b>GRU</b> was not compared.", "what it rests on"),
        *("<nav>", 'class="player"', "<table", 'id="training"', 'id="data"'),
    ]
    places = [body.index(text) for text in order]
    assert places == sorted(places)


def test_clips_of_each_kind_play_their_own_motions() -> None:
    clips = [PlayedClip(f"clip {k}", "", (Panel("x", interaction(k)),)) for k in range(3)]
    page = replace(report(), clips=(clips[0],), gallery=(clips[1],), generated=(clips[2],))
    html = render_report(page)
    for number, section in enumerate(("clips", "variations", "generated")):
        at = html.index(f'id="{section}"')
        assert f'data-clip="{number}"' in html[at : html.index("</section>", at)]
        assert f'aria-label="clip clip {number}"' in html[at:]
    assert len(json.loads(Page(html).scripts[0])) == 3


def test_labels_of_tables_are_words() -> None:
    shown = [metric.label for metric in METRICS.values()] + [label for label, _ in ROWS.values()]
    code = re.compile(r"[a-z0-9]_[a-z0-9]")
    assert [label for label in shown if code.search(label)] == []
    # A key that has no label would be shown as it is, and be caught here too.
    page = Page(render_report(report()))
    assert [text for text in page.texts if code.search(text) and "/" not in text] == []


def test_every_table_scrolls_in_a_region_of_its_own_that_says_what_it_is() -> None:
    html = render_report(report())
    regions = re.findall(
        r'<div class="scroll" tabindex="0" role="region" aria-label="[^"]+">', html
    )
    assert html.count("<table") == len(regions) > 0
    style = read_asset("table.css")
    # Its edges are shaded where it goes on, and what scrolls is as wide as it needs to be.
    assert "overflow-x: auto" in style[style.index(".scroll {") :]


def test_captions_break_and_are_never_cut() -> None:
    for name in ("player.css", "report.css", "table.css"):
        rules = re.findall(r"([^{}]*)\{([^{}]*)\}", read_asset(name))
        captions = [body for selector, body in rules if "caption" in selector]
        assert not any("ellipsis" in body or "nowrap" in body for body in captions), name
