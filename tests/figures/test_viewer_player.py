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
PLAYER = "Pacmo.players[0]"
FPS = 30.0  # of the finest panel


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    folder: Path = tmp_path_factory.mktemp("page")
    page = render_report(report(HOSTILE, n_clips=20))
    (folder / "report.html").write_text(page, encoding="utf-8")
    with open_page(folder / "report.html", folder / "profile") as opened:
        opened.size(900, 700)
        in_sight(opened, 0)
        yield opened
        assert opened.complaints == []


def in_sight(tab: Tab, player: int) -> None:
    """Scroll to a clip, and wait for its picture."""
    this = f"Pacmo.players[{player}]"
    tab.run(f"{this}.root.scrollIntoView({{behavior: 'instant'}})")
    tab.wait_until(f"{this}.renderer && {this}.boxes && !{this}.asked")


def shown(tab: Tab, time: float) -> None:
    tab.run(f"{PLAYER}.play(false); {PLAYER}.seek({time})")
    tab.wait_until(f"!{PLAYER}.asked")


def where(tab: Tab, panel: int) -> list[list[float]]:
    """Say where the joints of the reaction are drawn."""
    asked = f"{PLAYER}.clips[{panel}].joints.map((_, j) => {PLAYER}.where({panel}, 1, j))"
    return [[float(x) for x in place] for place in tab.run(asked)]


def test_the_page_opens_without_a_word_in_the_console_or_a_request(tab: Tab) -> None:
    assert tab.complaints == []
    assert [url[:5] for url in tab.requests if not url.startswith("data:")] == ["file:"]


def test_a_name_with_markup_is_shown_and_not_run(tab: Tab) -> None:
    assert tab.run("document.title") == f"experiment {HOSTILE}: report of PaCMO"
    assert tab.run("document.querySelector('.clip h3 small').textContent") == HOSTILE


def test_scrubbing_moves_every_panel_and_goes_back(tab: Tab) -> None:
    shown(tab, 0)
    before = [where(tab, panel) for panel in (0, 1)]
    tab.run(
        f"{{ const scrub = {PLAYER}.parts.scrub; scrub.value = {5 / 15};"
        "scrub.dispatchEvent(new Event('input')); }"
    )
    tab.wait_until(f"!{PLAYER}.asked && Math.abs({PLAYER}.time - {5 / 15}) < 1e-3")
    assert all(where(tab, panel) != before[panel] for panel in (0, 1))
    shown(tab, 0)
    assert [where(tab, panel) for panel in (0, 1)] == before


def test_the_play_button_plays_and_pauses(tab: Tab) -> None:
    shown(tab, 0)
    tab.run(f"{PLAYER}.parts.play.click()")
    tab.wait_until(f"{PLAYER}.time > 0.1")
    tab.run(f"{PLAYER}.parts.play.click()")
    assert tab.run(f"{PLAYER}.parts.play.getAttribute('aria-label')") == "play"


def test_keys_go_to_the_clip_that_has_the_focus(tab: Tab) -> None:
    shown(tab, 0)
    tab.run(f"{PLAYER}.root.focus({{preventScroll: true}})")
    tab.press("ArrowRight")
    tab.press("ArrowRight")
    tab.wait_until(f"Math.abs({PLAYER}.time - {2 / FPS}) < 1e-6")
    assert tab.run("Pacmo.players[1].time") == 0


def test_dragging_turns_every_panel_and_a_double_click_turns_them_back(tab: Tab) -> None:
    shown(tab, 0)
    before = [where(tab, panel) for panel in (0, 1)]
    box = tab.run(f"(({{x, y}}) => [x, y])({PLAYER}.parts.panels.getBoundingClientRect())")
    for kind, shift in (("mousePressed", 0), ("mouseMoved", 60), ("mouseReleased", 60)):
        tab.call(
            "Input.dispatchMouseEvent",
            type=kind, x=box[0] + 40 + shift, y=box[1] + 90, button="left", buttons=1, clickCount=1,
        )  # fmt: skip
    tab.wait_until(f"!{PLAYER}.asked && {PLAYER}.look.yaw !== 0")
    assert all(where(tab, panel) != before[panel] for panel in (0, 1))
    tab.run(f"{PLAYER}.parts.panels.dispatchEvent(new MouseEvent('dblclick'))")
    tab.wait_until(f"!{PLAYER}.asked && {PLAYER}.look.yaw === 0")
    assert [where(tab, panel) for panel in (0, 1)] == before


def test_of_twenty_clips_those_in_sight_alone_hold_a_picture_in_3d(tab: Tab) -> None:
    for player in range(0, 20, 4):
        in_sight(tab, player)
        tab.wait_until("Pacmo.players.filter((p) => p.renderer).length <= 6")
    in_sight(tab, 0)
    shown(tab, 0.2)
