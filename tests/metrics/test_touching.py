"""Truth: distances of joints, and the samples that the same seed gives without ``--touch``."""

import re
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from pacmo_core.api import synthesise
from pacmo_core.commands import react as react_command
from pacmo_core.commands.cli import app
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.metrics import touching
from pacmo_core.metrics.touching import MIN_SECONDS, TouchName, check_hands, draw_until, is_as_asked
from pacmo_core.reaction.inference import PACKAGED
from pacmo_core.store.motions import stream_motions, write_motions

ACTS = synthesise(11)
HANDSHAKE, HUG = ACTS["handshake-1"], ACTS["hug-1"]


def touch(name: TouchName, clip: Interaction, reaction: Motion) -> bool:
    return is_as_asked(name, clip.skeleton, clip.times, clip.person_a, reaction)


def right_gap(clip: Interaction) -> float:
    hand = clip.skeleton.joints.index("right_wrist")
    return float(np.linalg.norm(clip.person_a[:, hand] - clip.person_b[:, hand], axis=-1).min())


@pytest.mark.parametrize(
    ("clip", "right", "body"), [(HANDSHAKE, True, False), (HUG, False, True)], ids=["shake", "hug"]
)
def test_a_handshake_is_of_right_hands_and_a_hug_of_bodies(
    clip: Interaction, right: bool, body: bool
) -> None:
    assert touch(TouchName.right_hands, clip, clip.person_b) == right
    assert touch(TouchName.body, clip, clip.person_b) == body
    assert touch(TouchName.by_partner, clip, clip.person_b) == body
    assert touch(TouchName.embrace, clip, clip.person_b) == body
    assert not touch(TouchName.no_hands, clip, clip.person_b)
    if right:
        assert touch(TouchName.hands, clip, clip.person_b)
        assert right_gap(clip) < 0.3  # wrists, of hands that shake


@pytest.mark.parametrize("name", list(TouchName))
def test_at_a_distance_nothing_touches(name: TouchName) -> None:
    far = HANDSHAKE.person_b + np.array([9, 0, 0], np.float32)
    assert touch(name, HANDSHAKE, far) == (name == TouchName.no_hands)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(("seconds", "is_touch"), [(MIN_SECONDS, True), (0.05, False)])
def test_hands_of_a_side_touch_for_a_tenth_of_a_second(
    side: str, seconds: float, is_touch: bool
) -> None:
    """Bring one hand of a far person to the partner's of the same side, for some frames."""
    clip = HANDSHAKE
    far = clip.person_b + np.array([9, 0, 0], np.float32)
    hand = clip.skeleton.joints.index(f"{side}_hand")
    frames = slice(10, 10 + round(seconds / float(np.diff(clip.times)[0])))
    far[frames, hand] = clip.person_a[frames, hand] + np.array([0.02, 0, 0], np.float32)
    found = {name for name in TouchName if touch(name, clip, far)}
    hands = {TouchName(f"{side}-hands"), TouchName.hands}
    assert found - {TouchName.body, TouchName.by_partner} == (hands if is_touch else set())
    assert TouchName.no_hands not in found


def test_a_skeleton_without_hands_is_refused() -> None:
    stick = Skeleton("stick", ("pelvis", "chest", "head"), (-1, 0, 1))
    with pytest.raises(ValueError, match="wanted a skeleton with a left and a right hand"):
        check_hands(TouchName.hands, stick)


@pytest.mark.parametrize(("wanted", "n_drawn"), [(2, 12), (100, 128)])
def test_the_first_that_pass_all_tests_are_kept(wanted: int, n_drawn: int) -> None:
    numbers = count(1)

    def is_multiple(of: int) -> Callable[[Motion], bool]:
        return lambda motion: int(motion[0, 0, 0, 0]) % of == 0

    motions, drawn, passed = draw_until(
        lambda: np.full((1, 1, 1, 3), next(numbers), np.float32),
        {"even": is_multiple(2), "threes": is_multiple(3)},
        wanted,
    )
    found = [int(motion[0, 0, 0, 0]) for motion in motions]
    assert found == list(range(6, 129, 6))[:wanted]
    assert drawn == n_drawn
    assert passed == {"even": n_drawn // 2, "threes": n_drawn // 3}


def react(partner: Path, out: Path, *words: object) -> Result:
    given = [partner, "--clip", "shake", "--person", "a", "--weights", PACKAGED, "--out", out]
    return CliRunner().invoke(app, ["react", *map(str, given), *map(str, words)])


@pytest.fixture(scope="module")
def partner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("partner") / "motions.parquet"
    with write_motions(path, HANDSHAKE.skeleton) as writer:
        writer.add("shake", HANDSHAKE)
    return path


def test_what_is_kept_are_the_samples_of_the_seed_that_touch(partner: Path, tmp_path: Path) -> None:
    out = tmp_path / "o.parquet"
    assert react(partner, out, "--samples", 8, "--temperature", 2).exit_code == 0
    every = [clip for _, clip in stream_motions(out)]
    shaking = [clip.person_b for clip in every if touch(TouchName.right_hands, clip, clip.person_b)]
    assert 0 < len(shaking) < 8
    words = ["--samples", len(shaking), "--temperature", 2, "--touch", "right-hands"]
    said = react(partner, out, *words)
    assert said.exit_code == 0, said.output
    (drawn,) = re.findall(
        rf"{len(shaking)} of (\d) reactions pass --touch right-hands;", said.stdout
    )
    assert len(shaking) <= int(drawn) <= 8
    written = [clip.person_b for _, clip in stream_motions(out)]
    np.testing.assert_array_equal(written, shaking)


def test_too_few_are_refused_with_their_number(
    partner: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(touching, "MAX_DRAWN", 3)
    monkeypatch.setattr(react_command, "MAX_DRAWN", 3)
    out = tmp_path / "o.parquet"
    said = react(partner, out, "--touch", "no-hands")
    assert said.exit_code == 1
    said_first = said.stderr.partition(":")[2].strip()
    assert said_first.startswith("0 of 3 reactions pass --touch no-hands; wanted 1: the model exp")
    assert not out.exists()
    said = react(partner, out, "--touch", "right-hands", "--samples", 9)
    assert "--touch right-hands: --samples must be 1 to 3; got 9" in said.stderr
    both = ["--touch", "right-hands", "--within-limits"]
    said = react(partner, out, *both, "--samples", 3, "--temperature", 2)
    assert re.search(
        r"[12] of 3 reactions pass --touch right-hands \(\d\) and --within-limits \(\d\); wanted "
        r"3; --samples [12] writes those\n$",
        said.stderr,
    )
    said = react(partner, out, *both, "--temperature", 0)
    assert "--within-limits: there is one reaction to choose from" in said.stderr
    assert react(partner, out, "--touch", "feet").exit_code == 2
    said = CliRunner().invoke(app, ["react", "--stream", "--touch", "no-hands"])
    assert "leave out --touch" in said.stderr


def test_of_those_within_limits_none_is_beyond_one(partner: Path, tmp_path: Path) -> None:
    out = tmp_path / "o.parquet"
    words = ["--samples", 8, "--temperature", 2, "--no-finish"]
    said = react(partner, out, *words)
    (within,) = re.findall(r"within every limit: samples ([0-9, ]+);", said.stdout)
    wanted = [clip.person_b for _, clip in stream_motions(out)]
    numbers = [int(number) for number in within.split(", ")]
    assert 0 < len(numbers) < 8
    said = react(partner, out, "--samples", len(numbers), *words[2:], "--within-limits")
    assert (
        f"{len(numbers)} of {numbers[-1] + 1} reactions pass --within-limits; the others"
        in said.stdout
    )
    assert "another --seed" not in said.stdout
    kept = [clip.person_b for _, clip in stream_motions(out)]
    np.testing.assert_array_equal(kept, [wanted[number] for number in numbers])
