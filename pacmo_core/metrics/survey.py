"""Shares of clips that people judge real, with intervals, and a mixed model of the answers.

Answers of one person, and answers to one clip, are correlated; an interval that assumes
independence is too narrow. The mixed model has a random intercept for each person and each clip:

    logit P(judged real) = a + b [captured] + u_person + v_clip,  u ~ N(0, s^2), v ~ N(0, t^2)

fitted by maximum likelihood, with the Laplace approximation of the integral over u and v.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

Array = NDArray[np.float64]
_Z = NormalDist().inv_cdf(0.975)
_MAX_NEWTON_STEPS = 60
_TOLERANCE = 1e-9
_MIN_SPREAD, _MAX_SPREAD = 1e-3, 20.0  # standard deviations of random intercepts, logits


@dataclass(frozen=True)
class Share:
    """A share of answers with its 95 % interval."""

    count: int
    of: int
    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class MixedModel:
    """The fitted model.

    Parameters
    ----------
    difference, low, high : logits by which captured clips are judged real more often than
        generated ones, with the 95 % interval for known standard deviations
    person_spread, clip_spread : standard deviations of the random intercepts, logits
    """

    difference: float
    low: float
    high: float
    person_spread: float
    clip_spread: float


def share(count: int, of: int) -> Share:
    """Return a share with its Wilson score interval (1927).

    Raises
    ------
    ValueError
        If there are no answers.
    """
    if not 0 <= count <= of or of == 0:
        raise ValueError(f"wanted 0 <= count <= of and of >= 1; got {count} of {of}")
    mean, z2 = count / of, _Z**2
    middle = (mean + z2 / (2 * of)) / (1 + z2 / of)
    half = _Z / (1 + z2 / of) * np.sqrt(mean * (1 - mean) / of + z2 / (4 * of**2))
    return Share(count, of, mean, float(middle - half), float(middle + half))


def fit_mixed(
    people: Sequence[object],
    clips: Sequence[object],
    captured: Sequence[bool],
    real: Sequence[bool],
) -> MixedModel:
    """Fit the mixed model.

    Parameters
    ----------
    people, clips : the participant and the clip of each answer
    captured : whether the clip is real
    real : whether it was judged real

    Raises
    ------
    ValueError
        If there are answers to one kind of clip only.
    """
    kind = np.asarray(captured, np.float64)
    if len(np.unique(kind)) < 2:
        raise ValueError("the model needs answers to captured and to generated clips")
    person, clip = (
        np.unique([str(x) for x in xs], return_inverse=True)[1] for xs in (people, clips)
    )
    design = np.concatenate(
        [np.stack([np.ones_like(kind), kind], 1), np.eye(person.max() + 1)[person],
         np.eye(clip.max() + 1)[clip]], axis=1,
    )  # fmt: skip
    answers = np.asarray(real, np.float64)
    groups = (person.max() + 1, clip.max() + 1)

    def cost(logs: Array) -> float:
        return _laplace(design, answers, groups, np.exp(logs))[0]

    bounds = [(np.log(_MIN_SPREAD), np.log(_MAX_SPREAD))] * 2
    # Without bounds, the logarithm of a standard deviation of zero would diverge.
    best = minimize(cost, np.log([0.5, 0.5]), method="Nelder-Mead", bounds=bounds)
    spreads = np.exp(best.x)
    _, mode, information = _laplace(design, answers, groups, spreads)
    half = _Z * float(np.sqrt(np.linalg.inv(information)[1, 1]))
    difference = float(mode[1])
    return MixedModel(difference, difference - half, difference + half, *map(float, spreads))


def _laplace(
    design: Array, answers: Array, groups: tuple[int, int], spreads: Array
) -> tuple[float, Array, Array]:
    """Return twice the negative log-likelihood, the mode, and the information matrix there."""
    ridge = np.concatenate(
        [[0.0, 0.0], *(np.full(n, s**-2) for n, s in zip(groups, spreads, strict=True))]
    )
    # A weak prior keeps the logit finite if everybody judged one kind of clip alike.
    ridge[:2] = 1e-4
    mode = np.zeros(design.shape[1])
    for _ in range(_MAX_NEWTON_STEPS):
        chance = expit(design @ mode)
        information = (design * (chance * (1 - chance))[:, None]).T @ design + np.diag(ridge)
        step = np.linalg.solve(information, design.T @ (answers - chance) - ridge * mode)
        mode += step * min(1.0, 4.0 / float(np.abs(step).max() + _TOLERANCE))
        if np.abs(step).max() < _TOLERANCE:
            break
    eta = design @ mode
    log_chance = answers @ eta - np.logaddexp(0, eta).sum()
    intercepts = mode[2:]
    prior = (ridge[2:] * intercepts**2).sum() - np.log(ridge[2:]).sum()
    _, volume = np.linalg.slogdet(information[2:, 2:])
    return float(-2 * log_chance + prior + volume), mode, information
