"""Truth: what fifty invented participants were told to say; the page is asked through a browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from pacmo_core.commands.study import count_answers
from pacmo_core.commands.study_store import GENERATED, REAL, Study
from tests.commands.studies import FRAMES, served, small_study

pytest.importorskip("websockets", reason="websockets speaks to the browser")

from tests.figures.browser import CHROMIUM, Tab, open_page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]
PER_PERSON = 14
READY = "!Pacmo.study.busy && !document.getElementById('{}').hidden"
NO_3D = "--disable-3d-apis"
CLOCK = "document.querySelector('#stage .clock').textContent"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return small_study(tmp_path / "s.sqlite")


@pytest.fixture
def tab(study: Path, tmp_path: Path) -> Iterator[Tab]:
    with served(study) as (address, _), open_page(address, tmp_path / "profile") as opened:
        opened.size(240, 400)  # software draws few pixels sooner
        yield opened
        assert opened.complaints == []


def participate(tab: Tab, number: int, wrong: dict[str, int], clips: int = PER_PERSON) -> None:
    """Agree if need be, and judge clips: so many of either kind wrongly, the rest rightly."""
    if not tab.run("document.getElementById('welcome').hidden"):
        press(tab, "begin", number)
    for _ in range(clips):
        tab.wait_until(f"({READY.format('clips')}) && {CLOCK}.includes('frame')")
        tab.run("Pacmo.study.player.play(false)")
        frames = int(tab.run(CLOCK).split()[-1]) + 1
        kind = next(kind for kind, n in FRAMES.items() if n == frames)
        wrong[kind] -= 1
        press(tab, "real" if (kind == REAL) == (wrong[kind] < 0) else "fake", number)


def press(tab: Tab, button: str, number: int) -> None:
    """Press a button by a finger, or by its key."""
    before = tab.run("Pacmo.study.open.length")
    if number % 2 and button != "begin":
        tab.press("r" if button == "real" else "g")
    else:
        tab.run(f"document.getElementById('{button}').click()")
    tab.wait_until(f"!Pacmo.study.busy && Pacmo.study.open.length !== {before}")


def again(tab: Tab) -> None:
    """Open the page again."""
    tab.run("window.isOld = true")
    tab.call("Page.reload")
    tab.wait_until(
        "!window.isOld && document.readyState === 'complete' && typeof Pacmo === 'object'"
        " && Pacmo.study !== undefined"
    )


def leave(tab: Tab) -> None:
    """Make room for somebody else: another browser, as far as the page can tell."""
    tab.run("localStorage.clear()")
    again(tab)


@pytest.mark.parametrize(
    ("people", "is_drawn"), [(3, True), pytest.param(50, False, marks=pytest.mark.scheduled)]
)
def test_the_table_of_answers_through_the_page_is_what_people_were_told_to_say(
    tab: Tab, study: Path, people: int, is_drawn: bool
) -> None:
    if not is_drawn:
        # As in a window out of sight: pictures by software take seconds a clip.
        unseen = "window.IntersectionObserver = class { observe() {} }"
        tab.call("Page.addScriptToEvaluateOnNewDocument", source=unseen)
        again(tab)
    for number in range(people):
        # One of seven captured clips is taken for made up, and 4 to 6 made-up ones for captured.
        participate(tab, number, {REAL: 1, GENERATED: 4 + number % 3})
        tab.wait_until(READY.format("thanks"))
        leave(tab)
    found = count_answers(Study(study).answers())
    fooled = sum(4 + number % 3 for number in range(people))
    assert found["people"] == people
    assert (found[REAL]["real"]["count"], found[REAL]["real"]["of"]) == (6 * people, 7 * people)
    assert found[REAL]["made_up"]["count"] == people
    taken = found[GENERATED]["real"]
    assert (taken["count"], taken["of"]) == (fooled, 7 * people)


def test_a_closed_page_goes_on_where_it_was_and_a_hasty_hand_is_counted_once(
    tab: Tab, study: Path
) -> None:
    participate(tab, 0, {REAL: 0, GENERATED: 0}, clips=3)
    tab.wait_until(READY.format("clips"))
    again(tab)
    tab.wait_until(READY.format("clips"))
    assert tab.run("document.querySelector('.count').textContent") == "clip 4 of 14"
    tab.run("for (const _ of 'twice') document.getElementById('real').click()")
    tab.wait_until(f"({READY.format('clips')}) && Pacmo.study.open.length === {PER_PERSON - 4}")
    assert len(Study(study).answers()) == 4


@pytest.mark.parametrize(("width", "height"), [(360, 640), (640, 360), (1280, 800)])
def test_a_phone_shows_clip_and_buttons_at_once_and_they_fit_a_finger(
    tab: Tab, width: int, height: int
) -> None:
    tab.size(width, height)
    tab.run("document.getElementById('begin').click()")
    tab.wait_until(READY.format("clips"))
    for name in ("#fake", "#real", "#stage .panels"):
        box = f"document.querySelector('{name}').getBoundingClientRect()"
        left, top, right, bottom = (
            tab.run(f"{box}.{x}") for x in ("left", "top", "right", "bottom")
        )
        assert 0 <= left < right <= width
        assert 0 <= top < bottom <= height + 0.5
        assert bottom - top >= 44


def test_a_browser_without_3d_is_told_so_and_judges_nothing(study: Path, tmp_path: Path) -> None:
    with served(study) as (address, _), open_page(address, tmp_path / "p", NO_3D) as tab:
        tab.run("document.getElementById('begin').click()")
        tab.wait_until("!document.getElementById('flat').hidden")
    assert all(c.times_shown == 0 for c in Study(study).candidates())
