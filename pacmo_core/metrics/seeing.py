"""Metrics of one row that see the partner, and those of plausible motion."""

import numpy as np

from pacmo_core.metrics.closeness import Components, components_of, distance_functions
from pacmo_core.metrics.diversity import feature_distances
from pacmo_core.metrics.intervals import Array, Estimate
from pacmo_core.metrics.laws import Laws
from pacmo_core.metrics.matching import matching
from pacmo_core.metrics.pair_kernels import PairMmd
from pacmo_core.metrics.pairs import Codes
from pacmo_core.metrics.plausibility import contact_agreement, foot_sliding, penetration
from pacmo_core.metrics.reactions import Reactions
from pacmo_core.metrics.rows import as_estimate
from pacmo_core.metrics.yardstick import Yardstick

Estimates = dict[str, Estimate]
Reasons = dict[str, str]


class PartnerMetrics:
    """Metrics that change when reactions are dealt to other partners.

    Parameters
    ----------
    yardstick : Yardstick
    """

    def __init__(self, yardstick: Yardstick) -> None:
        self._yardstick = yardstick
        self._components = self._components_of_train()
        seconds = [self._coordinates(second) for second in yardstick.seconds]
        self._laws = Laws(self._coordinates(yardstick.real), seconds, yardstick)
        self._pairs = PairMmd(yardstick)

    def measure(self, row: Reactions) -> Estimates:
        """Measure F²ID of distances between the bodies, MMD of pairs and matching."""
        partners, settings = self._yardstick.partners, self._yardstick.settings
        draws = {
            "f2id_distances": self._laws.second(self._coordinates(row), partners),
            "mmd_pair": self._pairs.measure(row),
            "matching": matching(
                row.embedded,
                partners,
                self._yardstick.counts,
                candidates=settings.candidates,
            ),
        }
        return {name: as_estimate(values) for name, values in draws.items()}

    def dealt(self, row: Reactions, groups: Codes) -> Estimates:
        """Measure what can be had in the mean over all dealings of a row's reactions."""
        return {"mmd_pair": as_estimate(self._pairs.dealt(row, groups))}

    def _components_of_train(self) -> Components:
        settings, train = self._yardstick.settings, self._yardstick.train
        functions = distance_functions(train, settings.body, settings.n_instants)
        return components_of(functions, settings.n_components)

    def _coordinates(self, row: Reactions) -> Array:
        settings = self._yardstick.settings
        functions = distance_functions(row, settings.body, settings.n_instants)
        return self._components.coordinates(functions)


def measure_plausibility(row: Reactions, yardstick: Yardstick) -> tuple[Estimates, Reasons]:
    """Measure foot sliding, inter-penetration and agreement of contact; say what cannot be."""
    settings, real = yardstick.settings, yardstick.real
    sums = {
        "penetration": penetration(row, settings.body, radius=settings.body_radius),
        "contact_agreement": contact_agreement(row, real, distance=settings.contact_distance),
    }
    reasons = {"contact_agreement": "no frame with contact", "foot_sliding": "no foot stands"}
    if settings.body.feet:
        sums["foot_sliding"] = foot_sliding(row, real, settings.body, height=settings.foot_height)
    else:
        reasons["foot_sliding"] = "the skeleton names no feet"
    found: Estimates = {}
    for name, (above, below) in sums.items():
        weights = yardstick.counts[:, yardstick.partners]
        if (weights @ below > 0).all():
            found[name] = as_estimate((weights @ above) / (weights @ below))
    return found, {name: reason for name, reason in reasons.items() if name not in found}


def measure_multimodality(row: Reactions, yardstick: Yardstick) -> tuple[Estimates, Reasons]:
    """Average the L²(time) distance of features of several reactions to one partner.

    As Guo et al. (2020), *Action2Motion*, for actions: all pairs of a partner's reactions, a mean
    over partners.
    """
    samples = np.concatenate([row.features[None], row.further])
    if len(samples) < 2:
        return {}, {"multimodality": "one reaction a partner"}
    pairs = np.triu_indices(len(samples), k=1)
    spread = np.array(
        [
            feature_distances(samples[:, i], yardstick.weights, squared=False)[pairs].mean()
            for i in range(len(row))
        ]
    )
    weights = yardstick.counts[:, yardstick.partners]
    return {"multimodality": as_estimate(weights @ spread / weights.sum(axis=1))}, {}
