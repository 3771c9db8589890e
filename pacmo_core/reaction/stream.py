"""Reactions to a live partner, frame by frame."""

from collections import deque

import numpy as np
import torch
from numpy.typing import NDArray

from pacmo_core.data.interaction import Motion
from pacmo_core.data.transforms import body_frame
from pacmo_core.operators.spline import SmoothingSpline
from pacmo_core.reaction.react import evaluate_queries
from pacmo_core.reaction.windows import (
    ReactionModel,
    Window,
    WindowQuery,
    action_index,
    continuous_noise,
    mean_duration,
    sample_poses,
)

# Poses that stand for the window before the first frame, when the partner is taken to stand still.
N_PADDING_POSES = 32
# Share of the window, before and after its start, over which the frame of reference is averaged: a
# capture's noise in one pose's heading would swing all that is seen from it.
FRAME_SMOOTHING = 0.1
N_FRAME_POSES = 9


class ReactionStream:
    """Answers each frame of a partner from the last window of usual length, at its end.

    The window slides with the clock. Its frame of reference is that of the mean pose around its
    start, which moves as smoothly as the partner did, and its noise is one field of absolute time:
    so an answer follows on the last one. Before the first frame the partner is taken to have stood
    still.

    Parameters
    ----------
    model : a generator, or the deterministic baseline
    n_samples : S; 1 for the baseline
    random : CPU generator of the noise
    action : the interaction's label, for a model that was trained on labels
    """

    def __init__(
        self, model: ReactionModel, *, n_samples: int, random: torch.Generator, action: str = ""
    ) -> None:
        self._model = model
        self._action = action_index(model, action)
        self._noise = continuous_noise(model, n_samples, random)
        self._duration = mean_duration(model.normalisation)
        self._kept = (1 + FRAME_SMOOTHING) * self._duration
        self._seen = deque[tuple[float, Motion]]()
        self._began = 0.0

    def answer(self, pose: NDArray[np.float32], time: float) -> Motion:
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
            If the pose has another shape or is not finite, or time does not go on.
        """
        shape = (len(self._model.skeleton.joints), 3)
        if pose.shape != shape or not np.isfinite(pose).all():
            raise ValueError(f"a pose must be {shape} finite numbers; got {pose.shape}")
        if not np.isfinite(time):
            raise ValueError(f"time must be finite; got {time}")
        self._remember(pose, time)
        piece = self._piece(time)
        with torch.no_grad():
            (local,) = evaluate_queries(self._model, [piece])
        return piece.frame.to_world(local.reshape(-1, *shape))

    def _remember(self, pose: NDArray[np.float32], time: float) -> None:
        if not self._seen:
            self._began = time
            before = np.linspace(time - self._kept, time, N_PADDING_POSES, endpoint=False)
            self._seen.extend((float(instant), pose) for instant in before)
        if time <= self._seen[-1][0]:
            raise ValueError(f"time must go on from {self._seen[-1][0]:g} s; got {time:g}")
        self._seen.append((time, pose))
        while self._seen[1][0] <= time - self._kept:
            self._seen.popleft()

    def _piece(self, time: float) -> WindowQuery:
        times, seen = zip(*self._seen, strict=True)
        motion = SmoothingSpline(np.array(times), np.stack(seen))
        window = Window(time - self._duration, self._duration)
        around = (
            np.linspace(-FRAME_SMOOTHING, FRAME_SMOOTHING, N_FRAME_POSES) * self._duration
            + window.start
        )
        # A clock that counts from long ago rounds: no instant may come before the frames.
        steady = sample_poses(motion, around.clip(motion.start)).mean(axis=0, keepdims=True)
        since = (time - self._began) / self._duration
        return WindowQuery(
            owner=0,
            motion=motion,
            window=window,
            frame=body_frame(steady, self._model.skeleton),
            noise=self._noise.at(since) if self._noise else torch.zeros(0),
            action=self._action,
            rows=slice(0, 1),
            instants=np.array([time]),
            weights=np.ones(1),
        )
