"""Inference: reactions in the world to partners' motions of any length, at any times."""

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits
from torch import Tensor

from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.finish.body import TargetBody
from pacmo_core.finish.finish import finish
from pacmo_core.finish.learning import fitted_on, learn
from pacmo_core.operators.spline import Spline
from pacmo_core.reaction.baselines import Gru, frame_times
from pacmo_core.reaction.data import Condition, expand_directions
from pacmo_core.reaction.generator import Generator
from pacmo_core.reaction.inputs import UNLABELLED
from pacmo_core.reaction.windows import (
    PartnerMotion,
    ReactionModel,
    WindowQuery,
    is_deterministic,
    known_actions,
    needs_label,
    sample_poses,
    window_queries,
)
from pacmo_core.training.loop import TrainingData

# Bounds of memory: motions that go through the layers together, and times through the head.
MAX_MOTIONS_PER_BATCH = 64
MAX_TIMES_PER_BATCH = 4096
# Of the reactions to which the finish is fitted: clips, evenly among those there are, and samples.
MAX_FITTED_CLIPS, N_FITTED_SAMPLES, FITTING_SEED = 200, 2, 1
# The weights that are installed with the package.
PACKAGED = Path(__file__).parents[1] / "commands" / "starting_weights.safetensors"


def react(
    model: ReactionModel,
    partner: Motion,
    times: NDArray[np.float64],
    *,
    out_times: NDArray[np.float64],
    n_samples: int,
    random: torch.Generator,
) -> Motion:
    """React to one partner, without an action label; with one use ``react_all``.

    A motion longer than the model's training clips is divided into overlapping windows; time and
    memory grow linearly with its length.

    Parameters
    ----------
    model : Generator or Gru
    partner : (T, J, 3) float32, metres, in the world
    times, out_times : (T,), (T_out,) float64, seconds; the latter ascending, within the former
    n_samples : S; 1 for a deterministic model
    random : CPU generator of the noise

    Returns
    -------
    (S, T_out, J, 3) float32, metres, in the world

    Raises
    ------
    ValueError
        If a shape is wrong, an output time is outside ``times``, ``n_samples`` is not 1 for a
        deterministic model, or the model is conditioned on labels.
    """
    partners = [PartnerMotion(partner, times, out_times)]
    return react_all(model, partners, n_samples=n_samples, random=random)[0]


def react_all(
    model: ReactionModel,
    partners: Sequence[PartnerMotion],
    *,
    n_samples: int,
    random: torch.Generator,
) -> list[Motion]:
    """React to partners of any lengths and frame rates, in batches: ``(S, T_out_i, J, 3)`` each.

    Noise is sampled partner by partner, so that reactions do not depend on later partners.

    Raises
    ------
    ValueError
        As ``react``; and if a reaction is not finite.
    """
    n_joints = len(model.skeleton.joints)
    reactions: list[Motion] = []
    for partner in partners:
        _check_partner(partner, n_joints)
        reactions.append(np.zeros((n_samples, len(partner.out_times), n_joints, 3), np.float32))
    queries = window_queries(model, partners, n_samples, random)
    with torch.no_grad():
        while batch := list(islice(queries, max(1, MAX_MOTIONS_PER_BATCH // n_samples))):
            for query, local in zip(batch, evaluate_queries(model, batch), strict=True):
                motion = query.frame.to_world(local.reshape(*local.shape[:2], n_joints, 3))
                weights = query.weights.astype(np.float32)[:, None, None]
                reactions[query.partner][:, query.rows] += weights * motion
    if not all(np.isfinite(reaction).all() for reaction in reactions):
        raise ValueError("the reaction has values that are not finite: the weights are damaged")
    return reactions


def finish_reactions(
    model: ReactionModel,
    partner: PartnerMotion,
    reactions: Motion,
    body: TargetBody | None = None,
) -> Motion:
    """Finish the reactions to one partner: exact bones, planted feet, closed contacts.

    Parameters
    ----------
    model : that generated them, whose finish is applied
    partner : PartnerMotion
    reactions : (S, T_out, J, 3) float32, metres, in the world
    body : of the person who reacts; None for each reaction's own

    Returns
    -------
    (S, T_out, J, 3) float32, metres
    """
    poses = sample_poses(Spline(partner.times, partner.motion), partner.out_times)
    learnt = model.learnt.read()
    # Another number of threads rounds differently.
    with threadpool_limits(1, user_api="blas"):
        finished = [
            finish(reaction, poses, partner.out_times, model.skeleton, learnt, body)
            for reaction in reactions
        ]
    return np.stack(finished)


def fit_finish(model: ReactionModel, data: TrainingData[Interaction]) -> None:
    """Learn what the finish knows, ``model.learnt``, on validation clips.

    And on training clips, if there are few (``fitted_on``). A model that continued from weights
    keeps their finish.

    Parameters
    ----------
    model : trained
    data : clips, with labels if the model is conditioned on them
    """
    if model.learnt.has_learnt:
        return
    sides = ((data.validation, data.validation_actions), (data.train, data.train_actions))
    labelled = fitted_on(
        *(list(zip(clips, labels or [""] * len(clips), strict=True)) for clips, labels in sides)
    )
    usable = [(clip, label if needs_label(model) else UNLABELLED) for clip, label in labelled]
    usable = [pair for pair in usable if not needs_label(model) or pair[1] in known_actions(model)]
    chosen = np.unique(np.linspace(0, len(usable) - 1, MAX_FITTED_CLIPS).round().astype(int))
    examples = list(_examples(model, [usable[i] for i in chosen if usable]))
    model.learnt.store(learn(examples, model.skeleton))


def _examples(
    model: ReactionModel, labelled: Sequence[tuple[Interaction, str]]
) -> Iterator[tuple[Interaction, Motion]]:
    """Yield clips in both directions, and a generated reaction to their first person."""
    random = torch.Generator().manual_seed(FITTING_SEED)
    n_samples = 1 if is_deterministic(model) else N_FITTED_SAMPLES
    for clip, label in labelled:
        for directed in expand_directions([clip], both=True):
            times = directed.times
            partner = PartnerMotion(directed.person_a, times, times, label)
            (reactions,) = react_all(model, [partner], n_samples=n_samples, random=random)
            yield from ((directed, reaction) for reaction in reactions)


def _check_partner(partner: PartnerMotion, n_joints: int) -> None:
    if partner.motion.shape != (len(partner.times), n_joints, 3):
        raise ValueError(
            f"partner must be ({len(partner.times)}, {n_joints}, 3); got {partner.motion.shape}"
        )
    steps = np.diff(partner.out_times)
    if not len(partner.out_times) or (steps < 0).any():
        raise ValueError("out_times must ascend and not be empty")


def evaluate_queries(
    model: ReactionModel, queries: Sequence[WindowQuery]
) -> Iterator[NDArray[np.float32]]:
    """Yield ``(S, rows, 3 J)`` metres in each query's frame; S is the same for all queries."""
    if isinstance(model, Generator):
        return _evaluate_generator(model, queries)
    return (_evaluate_gru(model, query) for query in queries)


def _evaluate_generator(
    model: Generator, queries: Sequence[WindowQuery]
) -> Iterator[NDArray[np.float32]]:
    device = model.points.device
    n_samples = len(queries[0].noise)
    noise = torch.stack([query.noise for query in queries]).to(device)
    grid = torch.stack([_sample_on_grid(query, model.config.uno.n_points) for query in queries]).to(
        device
    )
    durations = np.array([query.window.duration for query in queries])
    log_duration = torch.tensor(np.log(durations).astype(np.float32), device=device)
    action = torch.tensor([query.action for query in queries], device=device)
    condition = Condition(
        grid.repeat_interleave(n_samples, dim=0),
        log_duration.repeat_interleave(n_samples),
        action.repeat_interleave(n_samples),
    )
    latent = model.latent(noise.flatten(0, 1), condition)
    latent = latent.view(len(latent), len(queries), n_samples, -1)
    for i, query in enumerate(queries):
        parts = []
        for first in range(0, len(query.out_times), MAX_TIMES_PER_BATCH):
            times = query.out_times[first : first + MAX_TIMES_PER_BATCH]
            condition = Condition(
                torch.tensor(query.sample_partner(times), device=device).expand(n_samples, -1, -1),
                log_duration[i].expand(n_samples),
                action[i].expand(n_samples),
            )
            normalised = torch.from_numpy(query.window.normalise(times)).to(device)
            parts.append(model.evaluate(latent[:, i], noise[i], condition, normalised))
        yield torch.cat(parts, dim=1).cpu().numpy()


def _sample_on_grid(query: WindowQuery, n_points: int) -> Tensor:
    window = query.window
    return torch.tensor(query.sample_partner(np.linspace(window.start, window.end, n_points)))


def _evaluate_gru(model: Gru, query: WindowQuery) -> NDArray[np.float32]:
    times = frame_times(query.window.start, query.window.end, model.config.fps)
    partner = torch.tensor(query.sample_partner(times), device=model.normalisation.scale.device)
    reaction = model(partner[None]).cpu().numpy()
    motion: NDArray[np.float32] = Spline(times, reaction[0])(query.out_times)[None].astype(
        np.float32
    )
    return motion
