"""Truth: a source is natural; a foot below the floor is as deep as it was put."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks._retargeting_tasks import SETTINGS
from pacmo_core.metrics.naturalness import naturalness
from tests.skeleton_prior.examples import SMALL, interaction


def test_the_source_is_natural_and_what_sinks_is_below_the_floor():
    source = interaction(n_frames=12)
    scales = np.ones((1, 2, len(SMALL.bones)))
    measured = naturalness(source, SETTINGS, scales, [source])
    zero = ("knee_change", "elbow_change", "hip_change", "below_floor", "added_foot_skate")
    assert {name: measured[name] for name in zero} == pytest.approx(
        dict.fromkeys(zero, 0), abs=1e-3
    )
    assert measured["contacts_kept"] == 1
    sunk = replace(source, person_a=source.person_a - np.float32([0, 0.07, 0]))
    both = naturalness(source, SETTINGS, scales.repeat(2, axis=0), [sunk, source])
    assert both["below_floor"] == pytest.approx(0.035, abs=1e-4)  # the mean of two bodies
