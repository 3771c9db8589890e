"""What the tables call their columns and rows, which way is better, which go together."""

from dataclasses import dataclass

LOWER, CLOSER, HIGHER, UNKNOWN = "↓", "→", "↑", ""


@dataclass(frozen=True)
class Metric:
    """How a metric is written, and which way is better (``→``: closer to the row ``real``)."""

    label: str
    better: str
    unit: str
    meaning: str


METRICS = {
    "f2id": Metric("F²ID", LOWER, "", "distance of the laws of the features of interactions"),
    "f2id_excess": Metric("F²ID excess", LOWER, "", "F²ID to further real motion, above its floor"),
    "f2id_infinity": Metric("F²ID∞", LOWER, "", "F²ID extrapolated to infinitely many samples"),
    "fid": Metric("FID", LOWER, "", "distance of the laws of the features of clips"),
    "mmd_a": Metric("MMD-A", LOWER, "", "maximum mean discrepancy, frame by frame"),
    "mmd_s": Metric("MMD-S", LOWER, "", "maximum mean discrepancy of whole clips"),
    "diversity": Metric("Diversity", CLOSER, "", "squared distance of the features of two clips"),
    "f2id_distances": Metric(
        "F²ID, distances", LOWER, "", "F²ID of the distances between the two bodies over time"
    ),
    "mmd_pair": Metric("MMD, pairs", LOWER, "", "discrepancy of partner and reaction together"),
    "matching": Metric("Matching", HIGHER, "", "how often the true partner is picked among many"),
    "contact_agreement": Metric(
        "Contact", HIGHER, "", "agreement with the real reaction on when the bodies touch"
    ),
    "foot_sliding": Metric("Foot sliding", LOWER, "m/s", "speed of a standing foot on the ground"),
    "penetration": Metric("Penetration", LOWER, "", "share of frames in which the bodies merge"),
    "multimodality": Metric(
        "Multimodality", UNKNOWN, "", "distance of the features of reactions to one partner"
    ),
    "ape": Metric("APE", LOWER, "m", "average position error of the root"),
    "ave": Metric("AVE", LOWER, "m²", "average error of the root's variance over time"),
    "ape_joints": Metric("APE, joints", LOWER, "m", "average position error of all joints"),
    "ave_joints": Metric("AVE, joints", LOWER, "m²", "average variance error of all joints"),
    "f2id_published": Metric("F²ID", LOWER, "", "1,000 drawn with replacement, five times"),
    "diversity_published": Metric("Diversity", CLOSER, "", "over 500 disjoint pairs"),
    "mmd_a_published": Metric("MMD-A", LOWER, "", "biased, many bandwidths; at least 2/n"),
    "mmd_s_published": Metric("MMD-S", LOWER, "", "biased, many bandwidths; at least 2/n"),
    "e_r": Metric("E_r", LOWER, "", "reconstruction error"),
    "e_b": Metric("E_b", LOWER, "", "error of bone lengths"),
    "jpd": Metric("JPD", LOWER, "", "difference of the distances between the two bodies' joints"),
}

# What a first look shows; reports/metrics.json holds every metric.
MAIN_COLUMNS = ("f2id", "f2id_excess", "mmd_a", "mmd_s", "diversity", "ape")
PARTNER_COLUMNS = ("f2id_distances", "mmd_pair", "matching", "contact_agreement", "ape_joints")
FURTHER_COLUMNS = ("foot_sliding", "penetration", "multimodality", "f2id_infinity", "ave")
PUBLISHED_COLUMNS = (
    *("f2id_published", "diversity_published", "mmd_a_published", "mmd_s_published"),
    *("ape", "ave"),
)

ROWS = {
    "real": ("Real motion", "of laws a second draw, the floor; else the pairs tested"),
    "oracle": ("Oracle", "a fresh draw from the true law: how good a score can get"),
    "pacmo": ("PaCMO", ""),
    "pacmo_augmented": ("PaCMO, augmented", "trained on clips and their variations"),
    "pacmo_paper": ("PaCMO, plain", "in the paper's form"),
    "regression": ("Regression", "the same operator, trained to predict one reaction"),
    "gru": ("GRU", "baseline"),
    "wrong_partner": ("Wrong partner", "real reactions, shuffled among partners"),
    "real_pairs": ("Real pairs", "the pairs tested"),
    "pacmo_permuted": ("PaCMO, wrong partner", "its reactions, shuffled among partners"),
    "real_pairs_same_act": ("Real pairs", "of acts that others perform too"),
    "wrong_partner_same_act": ("Wrong partner, same act", "real reactions, shuffled in each act"),
    "pacmo_same_act": ("PaCMO", "of acts that others perform too"),
    "pacmo_permuted_same_act": ("PaCMO, wrong partner, same act", "shuffled in each act"),
}
MODELS = ("pacmo", "pacmo_augmented", "pacmo_paper", "regression", "gru")
MAIN_ROWS = ("real", "oracle", *MODELS, "wrong_partner", "pacmo_permuted")
SAME_ACT_ROWS = (
    *("real_pairs_same_act", "wrong_partner_same_act"),
    *("pacmo_same_act", "pacmo_permuted_same_act"),
)
# Never marked as the best of a column: they are what models are read against.
REFERENCES = {name for name in ROWS if name not in MODELS}
