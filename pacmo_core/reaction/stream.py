"""Streaming inference: reactions to a live partner, frame by frame."""

from collections import deque
from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.transforms import body_frame
from pacmo_core.finish.finish import FrameFinish
from pacmo_core.operators.spline import SmoothingSpline
from pacmo_core.reaction.inference import evaluate_queries
from pacmo_core.reaction.windows import (
    ReactionModel,
    Window,
    WindowQuery,
    action_index,
    continuous_noise,
    mean_duration,
    sample_poses,
)

# Copies of the first pose that fill the window before it: the partner is assumed to stand still.
N_PADDING_POSES = 32
# Part of the window, before and after its start, over which the frame of reference is averaged:
# noise in the heading of a single pose would rotate all that is transformed to its frame.
FRAME_SMOOTHING = 0.1
N_FRAME_POSES = 9
# Seconds between frames after which a stream begins anew: forwards, and backwards, as of a clock
# that is set back. Frames that are late by less are left out.
MAX_PAUSE, MAX_LATE = 60.0, 1.0
# Metres a second beside the root beyond which a joint of a live partner was not tracked: hands
# reach half of it in a punch. It is kept where it was beside the root.
MAX_JOINT_SPEED = 15.0
# Seconds between frames, as where a sensor lost the partner, beyond which poses on straight lines
# fill the pause: a cubic through noisy frames would swing by metres in it.
MAX_STEP = 0.25


class UnusableFrameError(ValueError):
    """A frame of a live partner that can be left out: late, repeated, or not tracked."""


class ReactionStream:
    """React to each frame of a partner at the end of a sliding window.

    The window has the mean duration of the training clips. Its frame of reference is that of the
    mean pose around its start, which changes smoothly, and its noise is a random field of absolute
    time: so reactions are continuous. Before the first frame the partner is assumed to stand still,
    and to move straight on while frames are missing; after a minute without any, or where
    the clock is set back, it begins anew.

    Parameters
    ----------
    model : Generator or Gru
    n_samples : S; 1 for a deterministic model
    random : CPU generator of the noise
    action : label of the interaction, for a model that is conditioned on labels
    finish : whether bones keep their lengths and feet stay above the floor; see ``FrameFinish``
    """

    def __init__(
        self,
        model: ReactionModel,
        *,
        n_samples: int,
        random: torch.Generator,
        action: str = "",
        finish: bool = False,
    ) -> None:
        self._model = model
        self._finish: Callable[[Motion], Motion] | None = None if finish else _unchanged
        self._action = action_index(model, action)
        self._new_noise = partial(continuous_noise, model, n_samples, random)
        self._noise = self._new_noise()
        self._duration = mean_duration(model.normalisation)
        self._buffer_duration = (1 + FRAME_SMOOTHING) * self._duration
        self._frames = deque[tuple[float, Motion]]()
        self._start = 0.0

    def react(self, pose: NDArray[np.float32], time: float) -> Motion:
        """React to one more frame.

        Parameters
        ----------
        pose : (J, 3) float32, metres, in the world
        time : seconds, later than the last frame's

        Returns
        -------
        (S, J, 3) float32, metres, in the world

        Raises
        ------
        ValueError
            If the pose has another shape, or the time is not finite.
        UnusableFrameError
            If the pose is not finite, or the time not later than the last; later frames may follow.
        """
        shape = (len(self._model.skeleton.joints), 3)
        if pose.shape != shape:
            raise ValueError(f"a pose must be {shape} numbers; got {pose.shape}")
        if not np.isfinite(pose).all():
            joint = self._model.skeleton.joints[np.argwhere(~np.isfinite(pose))[0, 0]]
            raise UnusableFrameError(f"a pose must be of finite numbers; that of {joint} is not")
        if not np.isfinite(time):
            raise ValueError(f"time must be finite; got {time}")
        self._append(pose, time)
        query = self._query(time, np.array([time]))
        if self._finish is None:
            # The reaction to a partner who stands still, in the whole of the first window.
            window = np.linspace(query.window.start, time, N_PADDING_POSES)
            first = self._evaluate(self._query(time, window))
            learnt = self._model.learnt.read()
            self._finish = FrameFinish(first, pose, self._model.skeleton, learnt)
        return self._finish(self._evaluate(query)[:, 0])

    def _evaluate(self, query: WindowQuery) -> Motion:
        """``(S, T, J, 3)`` metres, in the world."""
        with torch.no_grad():
            (local,) = evaluate_queries(self._model, [query])
        joints = len(self._model.skeleton.joints)
        return query.frame.to_world(local.reshape(*local.shape[:2], joints, 3))

    def _append(self, pose: NDArray[np.float32], time: float) -> None:
        if self._frames and not -MAX_LATE <= time - self._frames[-1][0] <= MAX_PAUSE:
            self._frames.clear()
            self._noise = self._new_noise()
        if not self._frames:
            self._start = time
            padding = np.linspace(
                time - self._buffer_duration, time, N_PADDING_POSES, endpoint=False
            )
            self._frames.extend((float(earlier), pose) for earlier in padding)
        last, pose_before = self._frames[-1]
        if time <= last:
            raise UnusableFrameError(f"time must be later than {last:g} s; got {time:g}")
        pose = self._tracked(pose, pose_before, time - last)
        n_steps = int(np.ceil((time - last) / MAX_STEP))
        for share in np.arange(1, n_steps) / n_steps:
            between = (1 - share) * pose_before + share * pose
            self._frames.append((last + share * (time - last), between.astype(np.float32)))
        self._frames.append((time, pose))
        while self._frames[1][0] <= time - self._buffer_duration:
            self._frames.popleft()

    def _tracked(self, pose: Motion, before: Motion, seconds: float) -> Motion:
        """Return a pose in which joints that no body moves so fast stay beside the root."""
        root = self._model.skeleton.root
        beside, kept = pose - pose[root], before - before[root]
        is_lost = np.linalg.norm(beside - kept, axis=-1) > MAX_JOINT_SPEED * seconds
        return np.where(is_lost[:, None], pose[root] + kept, pose)

    def _query(self, time: float, out_times: NDArray[np.float64]) -> WindowQuery:
        times, poses = zip(*self._frames, strict=True)
        motion = SmoothingSpline(np.array(times), np.stack(poses))
        window = Window(time - self._duration, self._duration)
        around = (
            np.linspace(-FRAME_SMOOTHING, FRAME_SMOOTHING, N_FRAME_POSES) * self._duration
            + window.start
        )
        # Clipped, for large times are rounded and must not lie before the first frame.
        mean_pose = sample_poses(motion, around.clip(motion.start)).mean(axis=0, keepdims=True)
        n_windows = (time - self._start) / self._duration
        return WindowQuery(
            partner=0,
            motion=motion,
            window=window,
            frame=body_frame(mean_pose, self._model.skeleton),
            noise=self._noise.coefficients(n_windows) if self._noise else torch.zeros(0),
            action=self._action,
            rows=slice(0, len(out_times)),
            out_times=out_times,
            weights=np.ones(len(out_times)),
        )


def _unchanged(poses: Motion) -> Motion:
    return poses
