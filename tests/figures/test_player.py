"""Truth: what a browser that opens the file from disk says, shows and asks for."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pacmo_core.figures import render_report
from tests.figures.samples import report

pytest.importorskip("websockets", reason="websockets speaks to the browser")

from tests.figures.browser import CHROMIUM, Tab, open_page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]
HOSTILE = "<script>document.title = 'run'</script><img src=x onerror=\"document.title = 'run'\">"
CANVASES = "document.querySelectorAll('canvas')"
FRAME = "Number(document.querySelector('.clock').textContent.split(' ')[1])"


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    folder: Path = tmp_path_factory.mktemp("page")
    (folder / "report.html").write_text(render_report(report(HOSTILE)), encoding="utf-8")
    with open_page(folder / "report.html", folder / "profile") as opened:
        opened.wait_until("document.querySelector('.clock').textContent !== ''")
        opened.run("document.querySelector('.player').scrollIntoView({behavior: 'instant'})")
        yield opened
        assert opened.complaints == []


def pixels(tab: Tab, panel: int) -> str:
    return str(tab.run(f"{CANVASES}[{panel}].toDataURL()"))


def seek(tab: Tab, time: float) -> None:
    tab.run(
        "{ const scrub = document.querySelector('.scrub');"
        f"scrub.value = {time}; scrub.dispatchEvent(new Event('input')); }}"
    )


def test_the_page_opens_without_a_word_in_the_console_or_a_request(tab: Tab) -> None:
    assert tab.complaints == []
    assert [url[:5] for url in tab.requests if not url.startswith("data:")] == ["file:"]


def test_a_name_with_markup_is_shown_and_not_run(tab: Tab) -> None:
    assert tab.run("document.title") == f"experiment {HOSTILE}"
    assert tab.run("document.querySelector('.player h3 small').textContent") == HOSTILE


def test_scrubbing_shows_the_frame_and_moves_every_panel(tab: Tab) -> None:
    seek(tab, 0)
    tab.wait_until(f"{FRAME} === 1")
    before = [pixels(tab, panel) for panel in (0, 1)]
    seek(tab, 5 / 15)
    tab.wait_until(f"{FRAME} === 6")
    for panel, picture in enumerate(before):
        tab.wait_until(f"{CANVASES}[{panel}].toDataURL() !== {picture!r}")
    seek(tab, 0)
    for panel, picture in enumerate(before):
        tab.wait_until(f"{CANVASES}[{panel}].toDataURL() === {picture!r}")


def test_the_play_button_plays_and_pauses(tab: Tab) -> None:
    seek(tab, 0)
    tab.wait_until(f"{FRAME} === 1")
    tab.run("document.querySelector('.play').click()")
    tab.wait_until(f"{FRAME} > 3")
    tab.run("document.querySelector('.play').click()")
    assert tab.run("document.querySelector('.play').getAttribute('aria-label')") == "play"


def test_space_plays_and_arrows_step(tab: Tab) -> None:
    seek(tab, 0)
    tab.run("document.querySelector('.player').focus()")
    tab.press("ArrowRight")
    tab.press("ArrowRight")
    tab.wait_until(f"{FRAME} === 3")
    tab.press("ArrowLeft")
    tab.wait_until(f"{FRAME} === 2")
    tab.press(" ", " ")
    tab.wait_until(f"{FRAME} > 3")
    tab.press(" ", " ")
    assert tab.run("document.querySelector('.play').getAttribute('aria-label')") == "play"


def test_dragging_turns_the_view_of_every_panel_and_a_double_click_turns_it_back(tab: Tab) -> None:
    seek(tab, 0)
    tab.wait_until(f"{FRAME} === 1")
    before = [pixels(tab, panel) for panel in (0, 1)]
    box = tab.run("(({x, y}) => [x, y])(document.querySelector('canvas').getBoundingClientRect())")
    for kind, shift in (("mousePressed", 0), ("mouseMoved", 60), ("mouseReleased", 60)):
        tab.call(
            "Input.dispatchMouseEvent",
            type=kind, x=box[0] + 40 + shift, y=box[1] + 40, button="left", buttons=1, clickCount=1,
        )  # fmt: skip
    tab.wait_until(f"{CANVASES}[1].toDataURL() !== {before[1]!r}")
    assert pixels(tab, 0) != before[0]
    tab.run(f"{CANVASES}[0].dispatchEvent(new MouseEvent('dblclick'))")
    tab.wait_until(f"{CANVASES}[1].toDataURL() === {before[1]!r}")
