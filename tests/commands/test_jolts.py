"""Truth: a joint that jumps by a known distance in one frame."""

import numpy as np

from pacmo_core.commands.react import jolt_lines


def test_the_sample_whose_joint_jumps_is_named() -> None:
    times = np.arange(30) / 30
    smooth = np.zeros((30, 2, 3), np.float32)
    smooth[:, 0, 0] = np.sin(times)
    jumps = smooth.copy()
    jumps[12:, 1, 2] += 0.4  # 0.4 m in 1/30 s: 12 m/s from rest in 1/30 s
    assert jolt_lines(np.stack([smooth, smooth]), times) == []
    (line,) = jolt_lines(np.stack([smooth, jumps]), times)
    assert line.startswith("sample 1 has a jolt: a joint accelerates by 360 m/s²")
