"""Truth: the Parquet that the page was made from; a pinhole camera written out; pixels."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pacmo_core.data.interaction import Interaction, min_joint_distance
from pacmo_core.data.skeleton import NTU25, SBU15, Skeleton
from pacmo_core.figures.viewer import Scene, render_viewer
from pacmo_core.store.motions import read_motion, write_motions
from tests.figures.samples import interaction

pytest.importorskip("websockets", reason="websockets speaks to the browser")

from tests.figures.browser import CHROMIUM, Tab, open_page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]
HOSTILE = "<script>document.title = 'run'</script><img src=x onerror=\"document.title = 'run'\">"
PLAYER = "Pacmo.players[0]"
FPS = 30.0
BLUE = (86, 180, 233)  # person a in a dark page


def stored(folder: Path) -> Interaction:
    """Write a clip to Parquet, and read it back."""
    path = folder / "motions.parquet"
    with write_motions(path, NTU25) as writer:
        writer.add("one", interaction(3, NTU25, 40, FPS))
    return read_motion(path, "one")


def finer(seen: Interaction) -> Interaction:
    """Show the same motion by four times the frames, straight between its own."""
    at = np.arange(4 * len(seen.times) - 3) / 4 / FPS
    people = [
        np.stack([np.interp(at, seen.times, line) for line in m.reshape(len(m), -1).T], axis=1)
        .reshape(len(at), -1, 3)
        .astype(np.float32)
        for m in (seen.person_a, seen.person_b)
    ]
    return Interaction(seen.skeleton, at, *people)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Interaction:
    return stored(tmp_path_factory.mktemp("store"))


def opened(page: str, folder: Path) -> Iterator[Tab]:
    (folder / "view.html").write_text(page, encoding="utf-8")
    with open_page(folder / "view.html", folder / "profile") as tab:
        tab.call(
            "Network.emulateNetworkConditions",
            offline=True, latency=0, downloadThroughput=0, uploadThroughput=0,
        )  # fmt: skip
        tab.call("Page.reload")
        tab.wait_until("document.readyState === 'complete'")
        tab.size(900, 700, dark=True)
        tab.wait_until(f"{PLAYER}.boxes?.length > 0 && innerWidth === 900")
        yield tab
        assert tab.complaints == []


@pytest.fixture(scope="module")
def tab(clip: Interaction, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    scenes = [Scene.of("30 fps", clip), Scene.of(HOSTILE, finer(clip))]
    yield from opened(render_viewer(scenes, contact=0.1), tmp_path_factory.mktemp("page"))


def shown(tab: Tab, time: float) -> None:
    """Go to an instant, and wait for its picture."""
    tab.run(f"{PLAYER}.play(false); {PLAYER}.seek({time})")
    tab.wait_until(f"!{PLAYER}.asked")


def seen_by(tab: Tab, panel: int, places: np.ndarray) -> np.ndarray:
    """Project ``(N, 3)`` metres by the camera's own matrices: ``(N, 2)`` pixels of the page."""
    facts: dict[str, Any] = tab.run(
        f"(() => {{ const p = {PLAYER}, c = p.stages[{panel}].camera, b = p.boxes[{panel}],"
        "r = p.parts.panels.getBoundingClientRect(); return {at: [...c.matrixWorld.elements],"
        "fov: c.fov, aspect: c.aspect, box: [r.x + b.x, r.y + b.y, b.width, b.height]}; })()"
    )
    world = np.array(facts["at"]).reshape(4, 4).T
    right, up, back, eye = world[:3, :4].T
    away = places - eye
    depth = -(away @ back)
    slope = np.tan(np.radians(facts["fov"]) / 2)
    x, y = (away @ right) / depth / slope / facts["aspect"], (away @ up) / depth / slope
    left, top, width, height = facts["box"]
    return np.stack([left + (x + 1) / 2 * width, top + (1 - y) / 2 * height], axis=1)


def where(tab: Tab, panel: int, person: int) -> np.ndarray:
    asked = f"{PLAYER}.clips[{panel}].joints.map((_, j) => {PLAYER}.where({panel}, {person}, j))"
    return np.array(tab.run(asked))


def test_the_page_opens_from_disk_without_a_network_a_word_or_a_request(tab: Tab) -> None:
    assert tab.complaints == []
    assert {url[:5] for url in tab.requests if not url.startswith("data:")} == {"file:"}


def test_a_name_with_markup_is_shown_and_not_run(tab: Tab) -> None:
    assert tab.run("document.title") == f"30 fps · {HOSTILE}"
    labels = "[...document.querySelectorAll('figcaption span')].map((s) => s.textContent)"
    assert tab.run(labels) == ["30 fps", HOSTILE]


@pytest.mark.parametrize("frame", [0, 17, 39])
def test_joints_stand_where_the_parquet_has_them_to_a_pixel(
    tab: Tab, clip: Interaction, frame: int
) -> None:
    shown(tab, frame / FPS)
    for person, motion in enumerate((clip.person_a, clip.person_b)):
        wanted = seen_by(tab, 0, motion[frame].astype(np.float64))
        far = np.linalg.norm(where(tab, 0, person) - wanted, axis=1)
        assert far.max() < 0.5


def test_two_rates_on_one_clock_show_the_same_instant_between_frames(tab: Tab) -> None:
    shown(tab, 12.5 / FPS)
    shift = tab.run(f"{PLAYER}.boxes[1].x - {PLAYER}.boxes[0].x")
    for person in (0, 1):
        far = where(tab, 1, person) - where(tab, 0, person) - [shift, 0]
        assert np.abs(far).max() < 0.5


def test_space_plays_arrows_step_and_the_end_stops_without_a_loop(tab: Tab) -> None:
    shown(tab, 0)
    tab.run(f"{PLAYER}.root.focus()")
    tab.press("ArrowRight")
    tab.press("ArrowRight")
    tab.wait_until(f"Math.abs({PLAYER}.time - 2 / 120) < 1e-6")
    tab.press("ArrowLeft")
    tab.wait_until(f"Math.abs({PLAYER}.time - 1 / 120) < 1e-6")
    tab.press(" ", " ")
    tab.wait_until(f"{PLAYER}.time > 0.1")
    tab.press("l", "l")
    tab.wait_until(f"!{PLAYER}.playing && {PLAYER}.time === {PLAYER}.length")
    tab.press("l", "l")
    assert tab.run(f"{PLAYER}.on.loop") is True


def test_a_loop_begins_again(tab: Tab) -> None:
    shown(tab, 1.25)
    tab.run(f"{PLAYER}.play(true)")
    tab.wait_until(f"{PLAYER}.time < 1")
    tab.run(f"{PLAYER}.play(false)")


def test_scrubbing_and_a_press_on_the_plot_go_there(tab: Tab) -> None:
    tab.run(
        "{ const scrub = document.querySelector('.scrub'); scrub.value = 0.5;"
        "scrub.dispatchEvent(new Event('input')); }"
    )
    tab.wait_until("document.querySelector('.clock').textContent.startsWith('0.50 s')")
    x, y = tab.run(
        f"(() => {{ const b = {PLAYER}.parts.chart.getBoundingClientRect();"
        f"return [b.x + {PLAYER}.plot.x(0.75), b.y + 30]; }})()"
    )
    tab.click(x, y)
    tab.wait_until(f"Math.abs({PLAYER}.time - 0.75) < 0.02")


def test_series_are_what_numpy_measures(tab: Tab, clip: Interaction) -> None:
    def series(metric: str, person: int, joint: int) -> np.ndarray:
        return np.array(tab.run(f"[...{PLAYER}.clips[0].series('{metric}', {person}, {joint})]"))

    np.testing.assert_allclose(series("closest", 0, 0), min_joint_distance(clip), atol=3e-4)
    moved = np.linalg.norm(clip.person_b[2:, 7] - clip.person_b[:-2, 7], axis=-1) * FPS / 2
    np.testing.assert_allclose(series("speed", 1, 7)[1:-1], moved, atol=0.01)
    ground = tab.run(f"{PLAYER}.clips[0].view.ground")
    np.testing.assert_allclose(series("height", 0, 3), clip.person_a[:, 3, 1] - ground, atol=3e-4)


def test_a_click_picks_a_joint_and_a_second_one_their_distance(tab: Tab) -> None:
    shown(tab, 0)
    for person, joint in ((0, 3), (1, 20)):
        tab.run(f"{PLAYER}.do('side')")
        shown(tab, 0)
        tab.click(*where(tab, 0, person)[joint])
    picks = tab.run(f"{PLAYER}.picks.map(({{person, joint}}) => [person, joint])")
    assert picks == [[0, 3], [1, 20]]
    assert tab.run(f"{PLAYER}.on.distances") is True
    assert tab.run(f"{PLAYER}.parts.joint.value") == NTU25.joints[20]
    tab.run(f"{PLAYER}.picks = []; {PLAYER}.set('distances', false)")


def test_turning_and_following_keep_joints_where_the_camera_sees_them(
    tab: Tab, clip: Interaction
) -> None:
    tab.run(f"Object.assign({PLAYER}.look, {{yaw: 1, pitch: 0.7, zoom: 0.6, pan: [0.3, -0.1]}})")
    tab.run(f"{PLAYER}.set('follow', true)")
    shown(tab, 20 / FPS)
    wanted = seen_by(tab, 0, clip.person_b[20].astype(np.float64))
    assert np.linalg.norm(where(tab, 0, 1) - wanted, axis=1).max() < 0.5
    tab.run(f"{PLAYER}.do('side'); {PLAYER}.set('follow', false)")


@pytest.mark.parametrize("width", [360, 900])
def test_nothing_hangs_over_the_edge_of_a_phone_or_a_window(tab: Tab, width: int) -> None:
    tab.size(width, 760, dark=True)
    tab.wait_until(f"innerWidth === {width}")
    assert tab.run("document.documentElement.scrollWidth") <= width
    assert tab.run("document.documentElement.scrollHeight") <= 760
    tab.size(900, 700, dark=True)
    tab.wait_until("innerWidth === 900")


def test_the_picture_has_a_joint_where_the_parquet_has_it_to_a_pixel(tmp_path: Path) -> None:
    # A body of one joint is one ball, whose pixels have a middle.
    ball = Skeleton("ball", ("ball",), (-1,))
    a = np.array([[[-0.4, 1.0, 0.2]], [[0.1, 1.0, -0.2]], [[0.3, 1.2, 0.1]]], np.float32)
    page = render_viewer([Scene("ball", ball, np.arange(3) / FPS, (a,))], contact=0.1)
    for tab in opened(page, tmp_path):
        tab.run(f"{PLAYER}.set('bare', true); {PLAYER}.look.zoom = 1.2")
        for frame in range(3):
            shown(tab, frame / FPS)
            picture = np.asarray(Image.open(io.BytesIO(tab.picture())).convert("RGB"), float)
            blue = picture[..., 2] - picture[..., 0] > 30
            left, top, right, bottom = tab.run(
                "(({x, y, right, bottom}) => [x, y, right, bottom])"
                f"({PLAYER}.parts.panels.getBoundingClientRect())"
            )
            inside = np.zeros_like(blue)
            inside[int(top) : int(bottom), int(left) : int(right)] = True
            rows, columns = np.nonzero(blue & inside)
            assert len(rows) > 20
            (wanted,) = seen_by(tab, 0, a[frame].astype(np.float64))
            got = np.array([columns.mean() + 0.5, rows.mean() + 0.5])
            assert np.linalg.norm(got - wanted) <= 1


def test_as_many_as_six_clips_are_shown_and_not_more(clip: Interaction) -> None:
    scene = Scene.of("x", clip)
    assert render_viewer([scene] * 6, contact=0.1).count('class="cell"') == 6
    for count in (0, 7):
        with pytest.raises(ValueError, match="1 to 6"):
            render_viewer([scene] * count, contact=0.1)


def test_two_people_of_different_skeletons_stand_where_they_are(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    a, b = interaction(3, NTU25, 40, FPS), interaction(4, SBU15, 40, FPS)
    scene = Scene("two", NTU25, a.times, (a.person_a, b.person_b), SBU15)
    page = render_viewer([scene], contact=0.1)
    for tab in opened(page, tmp_path_factory.mktemp("two")):
        shown(tab, a.times[17])
        for person, motion in enumerate(scene.people):
            poses = f"Array.from({PLAYER}.clips[0].poses[{person}])"
            np.testing.assert_allclose(tab.run(poses), motion[17].reshape(-1), atol=1e-3)
        names = tab.run(f"[...{PLAYER}.parts.joint.options].map(o => o.value)")
        assert names == list(dict.fromkeys(NTU25.joints + SBU15.joints))
        shared = (set(NTU25.joints) & set(SBU15.joints)).pop()
        alone = (set(SBU15.joints) - set(NTU25.joints)).pop()
        for metric, joint, count in (
            ("closest", shared, 1), ("roots", shared, 1), ("same", shared, 1), ("same", alone, 0),
            ("height", shared, 2), ("height", alone, 1), ("speed", alone, 1), ("stretch", alone, 2),
        ):  # fmt: skip
            tab.run(
                f"{PLAYER}.parts.metric.value = '{metric}'; {PLAYER}.parts.joint.value = '{joint}';"
                f"{PLAYER}.choose()"
            )
            lines = tab.run(f"{PLAYER}.plot.lines.map(l => Array.from(l.values))")
            assert len(lines) == count, (metric, joint)
            assert np.isfinite(np.array(lines, float)).all()
        for switch in ("names", "distances", "trails", "bare", "contacts"):
            tab.run(f"{PLAYER}.set('{switch}', true); {PLAYER}.ask()")
        tab.wait_until(f"!{PLAYER}.asked")
        assert tab.complaints == []
