"""The metrics of one row: distances of distributions, displacement, dependence on the partner.

F²ID to the tested real reactions can be below that of two samples of real motion, since a row that
reacts to the same partners shares their sampling error. A row is therefore also compared with
real motion of other people who are tested too: one half of the tested people against the other.
Its F²ID minus that of the real pairs is its excess. Training clips have no part in it, so that
memorised motion does not lower it.

MMD of (partner, reaction) pairs has the kernel k((p, r), (p′, r′)) = k(p, p′) k(r, r′), both
Gaussian: it is zero only for equal joint distributions (Szabó and Sriperumbudur 2018,
*Characteristic and universal tensor product kernels*), so it depends on the pairing.
"""

from functools import cached_property

import numpy as np

from pacmo_core.metrics.bootstrap import Array, Estimate
from pacmo_core.metrics.context import EvaluationContext
from pacmo_core.metrics.displacement import position_errors, variance_errors
from pacmo_core.metrics.diversity import disjoint_pair_mean, feature_distances, matching_accuracy
from pacmo_core.metrics.f2id import (
    Codes,
    Gaussians,
    common_coordinates,
    extrapolate_to_infinity,
    fit_gaussians,
    flatten,
    gaussian_distances,
    weighted_f2id,
)
from pacmo_core.metrics.mmd import (
    as_sequence,
    mean_kernels,
    median_bandwidth,
    pair_means,
    published_statistic,
)
from pacmo_core.metrics.plausibility import (
    PrincipalComponents,
    distance_functions,
    fit_principal_components,
)
from pacmo_core.metrics.reactions import Reactions


class GaussianReference:
    """Gaussian processes fitted to real motion, once for all rows.

    Parameters
    ----------
    real : (n, D) coordinates of the tested real reactions
    second_sets : (m, D) of each second sample
    context : EvaluationContext
    """

    def __init__(self, real: Array, second_sets: list[Array], context: EvaluationContext) -> None:
        self._coordinates = real, second_sets
        self._context = context
        numbered = enumerate(zip(second_sets, context.second_sets, strict=True), start=1)
        self._second_codes = [context.codes(second, k) for k, (_, second) in numbered]

    def between(self, row: Array, codes: Codes) -> Array:
        """Return F²ID to the tested real reactions, (1 + bootstrap,)."""
        return gaussian_distances(self._real, fit_gaussians(row, codes, self._context.counts))

    def to_other_people(self, row: Array, codes: Codes) -> Array | None:
        """Return the mean F²ID to real reactions of other tested people, (1 + bootstrap,).

        Each half of the tested people is compared with the other, and the means are over several
        random halves. None where there are too few to be divided.
        """
        if not self._context.halves:
            return None
        distances = [
            gaussian_distances(fit_gaussians(row, codes, one), other)
            for halves, reals in zip(self._context.halves, self._real_halves, strict=True)
            for one, other in zip(halves, reversed(reals), strict=True)
        ]
        return np.asarray(np.mean(distances, axis=0))

    def excess(self, row: Array, codes: Codes) -> Array | None:
        """Return ``to_other_people`` minus that of the real pairs, (1 + bootstrap,), or None."""
        distances, real = self.to_other_people(row, codes), self._real_to_other_people
        return None if distances is None or real is None else distances - real

    @cached_property
    def _real_to_other_people(self) -> Array | None:
        return self.to_other_people(self._coordinates[0], self._context.partners)

    @cached_property
    def _real_halves(self) -> list[list[Gaussians]]:
        real, codes = self._coordinates[0], self._context.partners
        return [
            [fit_gaussians(real, codes, counts) for counts in halves]
            for halves in self._context.halves
        ]

    @cached_property
    def floor(self) -> Array:
        """The mean F²ID between the tested real reactions and the second samples."""
        real = self._real
        return np.asarray(
            np.mean([gaussian_distances(real, second) for second in self._second_sets], axis=0)
        )

    def infinity(self, row: Array, codes: Codes) -> Array:
        """Return F²ID extrapolated to infinitely many samples of both, (1 + bootstrap,)."""
        gaussian = fit_gaussians(row, codes, self._parts)
        return self._extrapolated(gaussian_distances(self._real_parts, gaussian))

    @cached_property
    def floor_infinity(self) -> Array:
        """The extrapolated floor: the difference between test and training clips."""
        real = self._real_parts
        distances = [
            gaussian_distances(real, fit_gaussians(x, codes, self._parts))
            for x, codes in zip(self._coordinates[1], self._second_codes, strict=True)
        ]
        return self._extrapolated(np.mean(distances, axis=0))

    def _extrapolated(self, values: Array) -> Array:
        """Return the mean over the repeats of the plain value, then the replicates."""
        parts = self._context.part_counts
        limits = extrapolate_to_infinity(values.reshape(parts.shape[:2]))
        repeats = self._context.settings.repeats
        return np.concatenate([[limits[:repeats].mean()], limits[repeats:]])

    @property
    def _parts(self) -> Array:
        parts = self._context.part_counts
        return parts.reshape(-1, parts.shape[-1])

    @cached_property
    def _real(self) -> Gaussians:
        return fit_gaussians(self._coordinates[0], self._context.partners, self._context.counts)

    @cached_property
    def _real_parts(self) -> Gaussians:
        return fit_gaussians(self._coordinates[0], self._context.partners, self._parts)

    @cached_property
    def _second_sets(self) -> list[Gaussians]:
        pairs = zip(self._coordinates[1], self._second_codes, strict=True)
        return [fit_gaussians(x, codes, self._context.counts) for x, codes in pairs]


class PairMmd:
    """MMD of (partner, reaction) pairs to second samples of real motion.

    Parameters
    ----------
    context : EvaluationContext
    """

    def __init__(self, context: EvaluationContext) -> None:
        self._context = context
        train = _motions(context, context.train)
        self._bandwidths = [np.array([median_bandwidth(motions)]) for motions in train]
        self._second_sets = [_motions(context, second) for second in context.second_sets]
        self._codes = [
            context.codes(second, k) for k, second in enumerate(context.second_sets, start=1)
        ]
        self._within = [
            pair_means(self._kernel(pairs, pairs), codes, codes, context.counts)
            for pairs, codes in zip(self._second_sets, self._codes, strict=True)
        ]

    def measure(self, row: Reactions) -> Array:
        """Return the mean unbiased squared MMD to the second samples, (1 + bootstrap,)."""
        pairs, partner_codes = _motions(self._context, row), self._context.partners
        counts = self._context.counts
        within = pair_means(self._kernel(pairs, pairs), partner_codes, partner_codes, counts)
        result = [
            within
            + other
            - 2 * pair_means(self._kernel(pairs, second), partner_codes, codes, counts)
            for second, codes, other in zip(
                self._second_sets, self._codes, self._within, strict=True
            )
        ]
        return np.asarray(np.mean(result, axis=0))

    def permuted(self, row: Reactions, groups: Codes) -> Array:
        """Return the mean of ``measure`` over all permutations of the reactions.

        Permuted at random within each group, pairs follow the product of the marginals, so the
        kernel's means are products of means and no permutation is sampled. Partners
        and reactions of a replicate have the weights of ``measure``, so that the difference is due
        to the pairing alone. A single permutation would about double the noise.

        Parameters
        ----------
        row : reactions with their true partners
        groups : (n,) int; reactions are permuted within their group

        Returns
        -------
        (1 + bootstrap,)
        """
        pairs = _motions(self._context, row)
        members = groups == np.unique(groups)[:, None]
        samples = members * self._context.counts[:, None, self._context.partners]  # (B, A, n)
        sizes = samples.sum(axis=2)
        shares = sizes / sizes.sum(axis=1, keepdims=True)
        mean = samples / np.maximum(sizes, 1)[:, :, None]  # a group may be absent from a replicate
        within = self._permuted_within(pairs, samples)
        result = []
        for second, codes, other in zip(self._second_sets, self._codes, self._within, strict=True):
            partner, reaction = self._kernels(pairs, second)
            weights = self._context.counts[:, codes]
            weights = weights / weights.sum(axis=1, keepdims=True)
            between = (mean @ partner) * (mean @ reaction)
            result.append(within + other - 2 * np.einsum("ba,bam,bm->b", shares, between, weights))
        return np.asarray(np.mean(result, axis=0))

    def _permuted_within(self, pairs: tuple[Array, Array], samples: Array) -> Array:
        partner_codes = self._context.partners
        foreign = (partner_codes[:, None] != partner_codes).astype(np.float64)
        numbers = _group_sums(samples, foreign)
        partner, reaction = (
            _group_sums(samples, kernel * foreign) / np.maximum(numbers, 1)
            for kernel in self._kernels(pairs, pairs)
        )
        # Pairs of groups are weighted by their number of pairs of different clips, as in
        # ``measure``; other weights would change the similarity of permuted pairs.
        return np.asarray((numbers * partner * reaction).sum((1, 2)) / numbers.sum((1, 2)))

    def _kernel(self, first: tuple[Array, Array], second: tuple[Array, Array]) -> Array:
        partner, reaction = self._kernels(first, second)
        return np.asarray(partner * reaction)

    def _kernels(
        self, first: tuple[Array, Array], second: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        triples = zip(first, second, self._bandwidths, strict=True)
        partner, reaction = (mean_kernels(x, y, bandwidth)[0] for x, y, bandwidth in triples)
        return partner, reaction


def _group_sums(samples: Array, values: Array) -> Array:
    """Return the sums of (n, n) values over the samples of each two groups, (B, A, A)."""
    return np.asarray(samples @ values @ samples.transpose(0, 2, 1))


def _motions(context: EvaluationContext, row: Reactions) -> tuple[Array, Array]:
    """Return partners and reactions as whole sequences, two (n, 1, T·J·3)."""
    return context.sequences(row.partners, row.times), context.sequences(row.motions, row.times)


Estimates = dict[str, Estimate]
Reasons = dict[str, str]
FEW_PEOPLE = "fewer than four pairs of people, or recordings, are tested"


def measure_f2id(
    row: Reactions, reference: GaussianReference, context: EvaluationContext
) -> tuple[Estimates, Reasons]:
    """Measure F²ID: plain, excess over real motion, extrapolated to infinitely many."""
    x = flatten(row.features, context.weights)
    codes = context.codes(row)
    result = {
        "f2id": as_estimate(reference.between(x, codes)),
        "f2id_infinity": as_estimate(reference.infinity(x, codes)),
    }
    excess = reference.excess(x, codes)
    if excess is None:
        return result, {"f2id_excess": FEW_PEOPLE}
    return result | {"f2id_excess": as_estimate(excess)}, {}


def measure_published_f2id(row: Reactions, context: EvaluationContext) -> Estimates:
    """Measure F²ID by the paper's protocol."""
    vectors = (flatten(part.features, context.weights) for part in (context.real, row))
    x, y = common_coordinates(*vectors)
    values = [
        weighted_f2id(x, y, sample_counts(a, len(x)), sample_counts(b, len(y)))
        for a, b in context.published_samples(row)
    ]
    return {"f2id_published": as_repeats(values)}


def measure_mmd(row: Reactions, codes: Codes, context: EvaluationContext) -> Estimates:
    """Measure MMD-A and MMD-S, unbiased, and by the paper's protocol."""
    i = context.partners
    stacked = context.stacked(row)
    shaped = {"mmd_a": stacked, "mmd_s": as_sequence(stacked)}
    result: Estimates = {}
    for name, real in context.real_kernels.items():
        yy = mean_kernels(shaped[name], shaped[name], real.bandwidths)
        xy = mean_kernels(real.motions, shaped[name], real.bandwidths)
        means = [
            pair_means(kernel[0], *clips, context.counts)
            for kernel, clips in ((real.kernels, (i, i)), (yy, (codes, codes)), (xy, (i, codes)))
        ]
        result[name] = as_estimate(means[0] + means[1] - 2 * means[2])
        kernels = [real.kernels[1:], yy[1:], xy[1:]]
        paper = [
            published_statistic(kernels, sample_counts(a, len(i)), sample_counts(b, len(codes)))
            for a, b in context.published_samples(row)
        ]
        result[f"{name}_published"] = as_repeats(paper)
    return result


def measure_diversity(row: Reactions, codes: Codes, context: EvaluationContext) -> Estimates:
    """Measure diversity, squared and plain, and by the paper's protocol."""
    squared = feature_distances(row.features, context.weights, squared=True)
    replicates = {"diversity": squared, "diversity_l2": np.sqrt(squared)}
    result = {
        name: as_estimate(pair_means(distances, codes, codes, context.counts))
        for name, distances in replicates.items()
    }
    paper = [disjoint_pair_mean(squared, samples) for _, samples in context.published_samples(row)]
    return result | {"diversity_published": as_repeats(paper)}


def measure_displacement(row: Reactions, context: EvaluationContext) -> Estimates:
    """Measure APE and AVE: errors against the real reaction to the same partner."""
    errors = {
        "ape": position_errors(row.motions, context.real.motions),
        "ave": variance_errors(row.motions, context.real.motions),
    }
    # Weights are those of the partner's clip, also if the reaction is from another clip.
    weights = context.counts[:, context.partners]
    weights = weights / weights.sum(axis=1, keepdims=True)
    root = {name: value[:, context.settings.body.root] for name, value in errors.items()}
    joints = {f"{name}_joints": value.mean(axis=1) for name, value in errors.items()}
    return {name: as_estimate(weights @ value) for name, value in (root | joints).items()}


def as_estimate(replicates: Array) -> Estimate:
    """Return an estimate from replicates; the first has every clip once."""
    return Estimate(float(replicates[0]), replicates[1:])


def as_repeats(values: list[float]) -> Estimate:
    """Return an estimate from repeats of the paper's protocol."""
    return Estimate(float(np.mean(values)), np.array(values))


def sample_counts(samples: Codes, n: int) -> Array:
    """Count how often each of n samples was drawn."""
    return np.bincount(samples, minlength=n).astype(np.float64)


class PartnerMetrics:
    """Metrics that change when reactions are permuted among partners.

    Parameters
    ----------
    context : EvaluationContext
    """

    def __init__(self, context: EvaluationContext) -> None:
        self._context = context
        self._components = self._components_of_train()
        second_sets = [self._coordinates(second) for second in context.second_sets]
        self._reference = GaussianReference(self._coordinates(context.real), second_sets, context)
        self._pairs = PairMmd(context)

    def measure(self, row: Reactions) -> tuple[Estimates, Reasons]:
        """Measure F²ID of distances between the bodies, MMD of pairs and matching."""
        partners, settings = self._context.partners, self._context.settings
        replicates = {
            "mmd_pair": self._pairs.measure(row),
            "matching": matching_accuracy(
                row.embedded,
                partners,
                self._context.counts,
                candidates=settings.candidates,
            ),
        }
        result = {name: as_estimate(values) for name, values in replicates.items()}
        distances = self._reference.to_other_people(self._coordinates(row), partners)
        if distances is None:
            return result, {"f2id_distances": FEW_PEOPLE}
        return result | {"f2id_distances": as_estimate(distances)}, {}

    def permuted(self, row: Reactions, groups: Codes) -> Estimates:
        """Measure the metrics with a closed form of the mean over all permutations of reactions."""
        return {"mmd_pair": as_estimate(self._pairs.permuted(row, groups))}

    def _components_of_train(self) -> PrincipalComponents:
        settings, train = self._context.settings, self._context.train
        functions = distance_functions(train, settings.body, settings.n_instants)
        return fit_principal_components(functions, settings.n_components)

    def _coordinates(self, row: Reactions) -> Array:
        settings = self._context.settings
        functions = distance_functions(row, settings.body, settings.n_instants)
        return self._components.coordinates(functions)
