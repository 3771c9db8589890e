"""Which metrics see the partner: those on which true pairs beat the same motions dealt anew."""

from collections.abc import Mapping
from dataclasses import dataclass

from pacmo_core.metrics.intervals import Estimate, Interval, difference

# What is good: less (−1), more (+1), or neither, where any difference counts (0).
GOOD = {
    **dict.fromkeys(("f2id", "f2id_excess", "f2id_infinity", "f2id_distances"), -1),
    **dict.fromkeys(("mmd_a", "mmd_s", "mmd_pair"), -1),
    **dict.fromkeys(("ape", "ave", "ape_joints", "ave_joints"), -1),
    **dict.fromkeys(("foot_sliding", "penetration"), -1),
    **dict.fromkeys(("matching", "contact_agreement"), +1),
    **dict.fromkeys(("diversity", "diversity_l2"), 0),
}

# Here real pairs are compared with themselves, and are perfect whatever the metric sees. The
# unbiased MMD is not among them: of reactions dealt anew it may as well be below zero.
PERFECT = frozenset(
    ("f2id", "f2id_infinity", "ape", "ave", "ape_joints", "ave_joints", "contact_agreement")
)

# Of reactions alone: dealt to other partners they stay the same motions, but for the other's clock.
BLIND = frozenset(("mmd_a", "mmd_s"))


@dataclass(frozen=True)
class Seen(Interval):
    """The paired difference of true pairs less dealt ones, and whether it tells them apart.

    Parameters
    ----------
    sees : the interval is clear of zero, on the good side where there is one
    """

    sees: bool


def sensitivity(
    true: Mapping[str, Estimate],
    dealt: Mapping[str, Estimate],
    confidence: float,
    *,
    left_out: frozenset[str] = frozenset(),
) -> dict[str, Seen]:
    """Compare every metric that both rows have, draw by draw.

    Parameters
    ----------
    true, dealt : metrics of the true pairs, and of the same reactions at other partners
    left_out : ``PERFECT`` where the true pairs are the real ones
    """
    names = [name for name in GOOD if name in true and name in dealt and name not in left_out]
    return {name: _seen(name, difference(true[name], dealt[name], confidence)) for name in names}


def _seen(name: str, found: Interval) -> Seen:
    below, above = found.high < 0, found.low > 0
    sees = {-1: below, 0: below or above, 1: above}[GOOD[name]]
    return Seen(found.mean, found.low, found.high, bool(sees) and name not in BLIND)
