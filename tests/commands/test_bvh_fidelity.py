"""Truth: errors that are put into a motion."""

from dataclasses import replace

import numpy as np
import pytest

from pacmo_core.commands.bvh_fidelity import Fidelity
from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.registry import PersonMotion
from tests.reaction.problems import delayed_mirror

CLIP = delayed_mirror(3, np.arange(60) / 30)


def test_the_mean_error_is_of_the_people_whose_file_is_not_exact() -> None:
    people = [PersonMotion(SBU15, CLIP.times, m) for m in (CLIP.person_a, CLIP.person_b)]
    off = CLIP.person_b.copy()
    off[:, 3, 0] += 0.15  # metres, of one of fifteen joints
    found = [people[0], replace(people[1], motion=off)]
    line = Fidelity.of(people, found, ["a.bvh", "b.bvh"]).error_line()
    assert "off by 10.0 mm on average, 150.0 mm at most" in line
    assert f"{SBU15.joints[3]} in frame" in line
    assert ", over 80 mm: look at that frame" in line
    off[:, 3, 0] -= 0.1
    within = Fidelity.of(people, [people[0], replace(people[1], motion=off)], ["a.bvh", "b.bvh"])
    assert within.error_line().endswith(")")
    off[:, 3, 0] += 0.1
    both = Fidelity.of(people, [replace(people[0], motion=CLIP.person_a + 0.01), found[1]], "ab")
    expected = (1e3 * np.sqrt(3) * 0.01 + 10) / 2
    assert f"off by {expected:.1f} mm on average" in both.error_line()
    assert Fidelity.of(people, people, "ab").error_line().endswith("no joint is off by 0.1 mm")


def test_feet_of_an_exact_partner_do_not_halve_the_slide_of_the_other() -> None:
    still = np.repeat(CLIP.person_b[:1], 60, axis=0)
    people = [PersonMotion(SBU15, CLIP.times, m) for m in (CLIP.person_a, still)]
    drifts = still + np.linspace(0, 0.1, 60, dtype=np.float32)[:, None, None] * [1, 0, 0]
    found = [people[0], replace(people[1], motion=drifts.astype(np.float32))]
    line = Fidelity.of(people, found, ["a.bvh", "b.bvh"]).line()
    speed = float(line.split("slide ")[1].split(" cm/s")[0])
    assert speed == pytest.approx(100 * 0.1 / float(CLIP.times[-1]), rel=0.02)
