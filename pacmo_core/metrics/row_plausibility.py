"""The metrics of one row, continued: contacts, plausibility, and the samples of one partner.

All are ratios of sums over reactions, which makes their bootstrap replicates cheap.
"""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from pacmo_core.metrics.bootstrap import MIN_UNITS, Array
from pacmo_core.metrics.contact import (
    contact_distances,
    contact_f1,
    contacts_met,
    false_contacts,
    nearest_in_time,
    penetration,
)
from pacmo_core.metrics.context import EvaluationContext
from pacmo_core.metrics.displacement import Motions
from pacmo_core.metrics.diversity import feature_distances
from pacmo_core.metrics.plausibility import (
    bone_variation,
    foot_skate,
    ground_penetration,
    jerk,
    jolts,
    lurches,
    step_length,
)
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.row_metrics import Estimates, Reasons, as_estimate


def measure_plausibility(row: Reactions, context: EvaluationContext) -> tuple[Estimates, Reasons]:
    """Measure how a motion is, and how deep bodies are; return reasons for missing metrics."""
    settings = context.settings
    sums = {
        "penetration": penetration(row, settings.body, radius=settings.body_radius),
        "bone_variation": bone_variation(row, settings.body),
        "jerk": jerk(row, smoothing=settings.smoothing),
        "jolts": jolts(row, context.real),
    }
    missing = {}
    if settings.body.shoulders:
        sums["lurches"] = lurches(row, context.real, settings.body, smoothing=settings.smoothing)
    else:
        missing["lurches"] = "the skeleton names no arms"
    if settings.body.feet:
        sums["foot_skate"] = foot_skate(row, settings.body, smoothing=settings.smoothing)
        sums["step_length"] = step_length(row, settings.body, smoothing=settings.smoothing)
        sums["ground_penetration"] = ground_penetration(row, context.real, settings.body)
    else:
        of_feet = ["foot_skate", "step_length", "ground_penetration"]
        missing |= dict.fromkeys(of_feet, "the skeleton names no feet")
    result = ratios(sums, context)
    return result, missing | dict.fromkeys(sums.keys() - result.keys(), "nobody walks")


def measure_contact(row: Reactions, context: EvaluationContext) -> tuple[Estimates, Reasons]:
    """Measure contacts met, over all clips and by action, false contacts, and their agreement.

    The metric of one action is named ``contacts_met.ACTION``. Actions with fewer than ``MIN_UNITS``
    clips with contact have none: it would rest on a few frames.
    """
    settings = context.settings
    generated, captured = contact_distances(row), contact_distances(context.real)
    near = [nearest_in_time(d, times) for d, times in zip(generated, row.times, strict=True)]
    limits = {"contact": settings.contact_distance, "met": settings.met_distance}
    met = contacts_met(generated, captured, **limits)
    actions = np.array(context.real.actions)
    named, n_touching = np.unique(actions[met[1] > 0], return_counts=True)
    sums = {
        "contacts_met": met,
        "contacts_met_near": contacts_met(near, captured, **limits),
        "false_contacts": false_contacts(
            generated, captured, apart=settings.apart_distance, met=settings.met_distance
        ),
        "contact_f1": contact_f1(generated, captured, distance=settings.contact_distance),
        **{
            f"contacts_met.{name}": met * (actions == name)
            for name in named[n_touching >= MIN_UNITS]
        },
    }
    result = ratios(sums, context)
    return result, {
        name: "no frame with contact" for name in sums if name not in result and "." not in name
    }


def measure_samples(row: Reactions, context: EvaluationContext) -> tuple[Estimates, Reasons]:
    """Measure the energy score and the dispersion of the reactions to one partner.

    The energy score ``E |X - u| - E |X - X'| / 2`` of samples X, X' against the real reaction u is
    strictly proper (Gneiting and Raftery 2007, *Strictly proper scoring rules, prediction, and
    estimation*, eq. 22, negated); the norm is the root mean square over time and joints, metres. A
    single reaction counts as a distribution at one point. The dispersion is the distance between
    two samples over that of a sample to the real reaction, both the mean over time and joints: 1
    where the samples vary as the real reactions do.
    """
    sets = [row.motions, *row.further_motions]
    errors = np.array([_distances(motions, context.real.motions) for motions in sets])
    pairs = np.array([_distances(x, y) for x, y in combinations(sets, 2)])
    n = np.ones(len(row))
    if not len(pairs):
        score = {"energy_score": np.array([errors[0, 0], n])}
        return ratios(score, context), {"dispersion": "one reaction per partner"}
    rms_error, mean_error = errors.mean(axis=0)
    rms_pair, mean_pair = pairs.mean(axis=0)
    sums = {
        "energy_score": np.array([rms_error - rms_pair / 2, n]),
        "dispersion": np.array([mean_pair, mean_error]),
    }
    result = ratios(sums, context)
    missing = {"dispersion": "the reactions are the real ones"}
    return result, {name: reason for name, reason in missing.items() if name not in result}


def _distances(first: Motions, second: Motions) -> Array:
    """Return the root mean square and the mean distance of joints over time, (2, n) metres."""
    distances = [
        np.linalg.norm(x.astype(np.float64) - y, axis=-1)
        for x, y in zip(first, second, strict=True)
    ]
    return np.array([[np.sqrt((d**2).mean()) for d in distances], [d.mean() for d in distances]])


def ratios(sums: Mapping[str, Array], context: EvaluationContext) -> Estimates:
    """Return ratios of sums over the clips of each replicate; without a denominator there is none.

    A replicate without one, as of a rare contact, takes the value of all clips.

    Parameters
    ----------
    sums : (2, n) of each metric, numerator and denominator of each reaction
    """
    weights = context.counts[:, context.partners]
    result = {}
    for name, (numerator, denominator) in sums.items():
        above, below = weights @ numerator, weights @ denominator
        if below[0] > 0:
            ratio = above / np.where(below > 0, below, 1)
            result[name] = as_estimate(np.where(below > 0, ratio, ratio[0]))
    return result


def measure_multimodality(row: Reactions, context: EvaluationContext) -> tuple[Estimates, Reasons]:
    """Return the mean L²(time) distance between features of reactions to the same partner.

    The mean is over all pairs of reactions and over partners; Guo et al. (2020), *Action2Motion*,
    do the same for actions.
    """
    samples = np.concatenate([row.features[None], row.further])
    if len(samples) < 2:
        return {}, {"multimodality": "one reaction per partner"}
    pairs = np.triu_indices(len(samples), k=1)
    spread = np.array(
        [
            feature_distances(samples[:, i], context.weights, squared=False)[pairs].mean()
            for i in range(len(row))
        ]
    )
    weights = context.counts[:, context.partners]
    return {"multimodality": as_estimate(weights @ spread / weights.sum(axis=1))}, {}
