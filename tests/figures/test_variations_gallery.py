"""Truth: what a browser shows of the variations in a report that it opens from disk."""

from dataclasses import replace
from pathlib import Path

import pytest

from pacmo_core.figures import render_report
from pacmo_core.figures.variations import played_variation
from tests.figures.samples import interaction, report
from tests.figures.test_variations import SHOWN

pytest.importorskip("websockets", reason="websockets speaks to the browser")

from tests.figures.browser import CHROMIUM, open_page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]
LAST = "Pacmo.players.at(-1)"


def test_source_and_variations_play_side_by_side_with_their_figures(tmp_path: Path) -> None:
    page = replace(
        report(n_clips=1),
        gallery=(played_variation("salsa", interaction(2), SHOWN, {"knee_change_p95": 3.0}),),
    )
    (tmp_path / "report.html").write_text(render_report(page), encoding="utf-8")
    with open_page(tmp_path / "report.html", tmp_path / "profile") as tab:
        tab.size(900, 700)
        tab.run(f"{LAST}.root.scrollIntoView({{behavior: 'instant'}})")
        tab.wait_until(f"{LAST}.renderer && {LAST}.boxes && !{LAST}.asked")
        captions = tab.run(
            "[...document.querySelectorAll('#variations figcaption')].map(x => x.textContent)"
        )
        assert [text.strip() for text in captions] == [
            *("Source", "b: child", "both bodies sampled, r0001")
        ]

        asked = f"[0, 1, 2].map(panel => {LAST}.where(panel, 1, 0))"
        before = tab.run(asked)
        tab.run(f"{LAST}.parts.play.click()")
        tab.wait_until(f"{LAST}.time > 0.1")
        tab.run(f"{LAST}.parts.play.click()")
        tab.wait_until(f"!{LAST}.asked")
        after = tab.run(asked)
        assert all(one != other for one, other in zip(before, after, strict=True))
        assert tab.complaints == []
