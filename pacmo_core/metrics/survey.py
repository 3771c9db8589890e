"""How often people take clips for real: shares with intervals, and a model of who said it of what.

Answers of one person, and of one clip, go together, and an interval that takes them for
independent is too narrow. The mixed model gives every person and every clip a random effect:

    logit P(taken for real) = a + b [captured] + u_person + v_clip,  u ~ N(0, s^2), v ~ N(0, t^2)

fitted by maximum likelihood, the random effects integrated out by Laplace's method.
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
_MAX_NEWTON_STEPS = 60  # of Newton's method
_TOLERANCE = 1e-9
_LEAST, _MOST = 1e-3, 20.0  # spreads of leanings, in logits


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
    difference, low, high : logits by which captured clips are taken for real more often than
        generated ones, with its 95 % interval; the spreads are taken as known
    person_spread, clip_spread : standard deviations of the leanings, logits
    """

    difference: float
    low: float
    high: float
    person_spread: float
    clip_spread: float


def share(count: int, of: int) -> Share:
    """Give a share its interval by Wilson's score (1927).

    Raises
    ------
    ValueError
        If there is nothing to count.
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
    people, clips : who answered, and of which clip
    captured : whether the clip is real
    real : whether it was taken for real

    Raises
    ------
    ValueError
        If not both kinds of clip were answered.
    """
    kind = np.asarray(captured, np.float64)
    if len(np.unique(kind)) < 2:
        raise ValueError("the model wants answers to captured and to generated clips")
    who, which = (np.unique([str(x) for x in xs], return_inverse=True)[1] for xs in (people, clips))
    design = np.concatenate(
        [np.stack([np.ones_like(kind), kind], 1), np.eye(who.max() + 1)[who],
         np.eye(which.max() + 1)[which]], axis=1,
    )  # fmt: skip
    said = np.asarray(real, np.float64)
    groups = (who.max() + 1, which.max() + 1)

    def cost(logs: Array) -> float:
        return _laplace(design, said, groups, np.exp(logs))[0]

    bounds = [(np.log(_LEAST), np.log(_MOST))] * 2
    # Without bounds on where it looks, spreads of nothing would go to minus infinity.
    best = minimize(cost, np.log([0.5, 0.5]), method="Nelder-Mead", bounds=bounds)
    spreads = np.exp(best.x)
    _, result, information = _laplace(design, said, groups, spreads)
    half = _Z * float(np.sqrt(np.linalg.inv(information)[1, 1]))
    difference = float(result[1])
    return MixedModel(difference, difference - half, difference + half, *map(float, spreads))


def _laplace(
    design: Array, said: Array, groups: tuple[int, int], spreads: Array
) -> tuple[float, Array, Array]:
    """Twice the negative log-likelihood, the mode, and the information at it."""
    ridge = np.concatenate(
        [[0.0, 0.0], *(np.full(n, s**-2) for n, s in zip(groups, spreads, strict=True))]
    )
    # A whisper of a prior keeps kinds of clip that everybody judged alike at a finite logit.
    ridge[:2] = 1e-4
    mode = np.zeros(design.shape[1])
    for _ in range(_MAX_NEWTON_STEPS):
        chance = expit(design @ mode)
        information = (design * (chance * (1 - chance))[:, None]).T @ design + np.diag(ridge)
        step = np.linalg.solve(information, design.T @ (said - chance) - ridge * mode)
        mode += step * min(1.0, 4.0 / float(np.abs(step).max() + _TOLERANCE))
        if np.abs(step).max() < _TOLERANCE:
            break
    eta = design @ mode
    log_chance = said @ eta - np.logaddexp(0, eta).sum()
    leanings = mode[2:]
    prior = (ridge[2:] * leanings**2).sum() - np.log(ridge[2:]).sum()
    _, volume = np.linalg.slogdet(information[2:, 2:])
    return float(-2 * log_chance + prior + volume), mode, information
