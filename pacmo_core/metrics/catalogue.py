"""The catalogue of metrics and of the rows of the tables.

A further metric is a function and a row of ``METRICS``, which the tables, the promotion gate, the
pooling, the test of sensitivity and the comparison with reference figures read.
"""

from dataclasses import dataclass, replace

LOWER, CLOSER_TO_REAL, HIGHER, UNKNOWN = "↓", "→", "↑", ""


@dataclass(frozen=True)
class Metric:
    """A metric: its label, the direction of improvement, its unit and meaning.

    Parameters
    ----------
    better : ``↓`` lower, ``↑`` higher, ``→`` closer to the row ``real``, empty if neither
    tolerance : relative difference allowed between trainings of one commit on different processors
    is_share : at most 1
    can_be_negative : true of unbiased estimates, excesses and extrapolations
    exact_for_real : real pairs are compared with themselves; their value is exact by construction
    partner_independent : depends on the reactions only, and not on their pairing with partners
    """

    label: str
    better: str
    unit: str
    meaning: str
    tolerance: float = 0.25
    is_share: bool = False
    can_be_negative: bool = False
    exact_for_real: bool = False
    partner_independent: bool = False


METRICS = {
    "f2id": Metric(
        "F²ID",
        LOWER,
        "",
        "Fréchet distance of the features of interactions",
        tolerance=0.5,
        exact_for_real=True,
    ),
    "f2id_excess": Metric(
        "F²ID excess",
        LOWER,
        "",
        "F²ID to further real motion, above its noise floor",
        tolerance=1.0,
        can_be_negative=True,
    ),
    "f2id_infinity": Metric(
        "F²ID∞",
        LOWER,
        "",
        "F²ID extrapolated to infinitely many samples",
        tolerance=1.0,
        can_be_negative=True,
        exact_for_real=True,
    ),
    "fid": Metric("FID", LOWER, "", "Fréchet distance of the features of clips", tolerance=0.5),
    "mmd_a": Metric(
        "MMD-A",
        LOWER,
        "",
        "maximum mean discrepancy, frame by frame",
        tolerance=1.0,
        can_be_negative=True,
        partner_independent=True,
    ),
    "mmd_s": Metric(
        "MMD-S",
        LOWER,
        "",
        "maximum mean discrepancy of whole clips",
        tolerance=1.0,
        can_be_negative=True,
        partner_independent=True,
    ),
    "diversity": Metric(
        "Diversity",
        CLOSER_TO_REAL,
        "",
        "squared distance of the features of two clips",
        tolerance=0.1,
    ),
    # A metric without a label is in the data, and in no table.
    "diversity_l2": Metric("", CLOSER_TO_REAL, "", "distance of the features of two clips"),
    "f2id_distances": Metric(
        "F²ID, distances", LOWER, "", "F²ID of the distances between the two bodies over time"
    ),
    "mmd_pair": Metric(
        "MMD, pairs",
        LOWER,
        "",
        "discrepancy of partner and reaction together",
        can_be_negative=True,
    ),
    "matching": Metric(
        "Matching",
        HIGHER,
        "",
        "share of reactions for which the true partner fits best among the candidates",
        is_share=True,
        tolerance=0.15,
    ),
    "contacts_met": Metric(
        "Contacts met",
        HIGHER,
        "",
        "share of the captured frames within 10 cm in which the generated two are within 15 cm",
        is_share=True,
        tolerance=0.15,
        exact_for_real=True,
    ),
    "contacts_met_near": Metric(
        "Contacts met ± 0.1 s",
        HIGHER,
        "",
        "the same, where a contact may be 0.1 s early or late",
        is_share=True,
        tolerance=0.15,
        exact_for_real=True,
    ),
    "false_contacts": Metric(
        "False contacts",
        LOWER,
        "",
        "share of the captured frames beyond 25 cm in which the generated two are within 15 cm",
        is_share=True,
        tolerance=1.0,
        exact_for_real=True,
    ),
    "contact_f1": Metric(
        "Contact F1",
        HIGHER,
        "",
        "agreement of the frames within 10 cm with those of the real reaction",
        is_share=True,
        tolerance=0.15,
        exact_for_real=True,
    ),
    "energy_score": Metric(
        "Energy score",
        LOWER,
        "m",
        "proper score of the samples against the real reaction; one reaction counts as a point",
        tolerance=0.1,
        exact_for_real=True,
    ),
    "dispersion": Metric(
        "Dispersion",
        UNKNOWN,
        "",
        "distance between two samples over that to the real reaction: 1 where samples vary as much",
        tolerance=0.1,
    ),
    "foot_skate": Metric(
        "Foot skate",
        LOWER,
        "m/s",
        "speed of the slower ankle, smoothed",
        partner_independent=True,
    ),
    "step_length": Metric(
        "Step length",
        CLOSER_TO_REAL,
        "m",
        "mean distance between the ankles along the way, where the body walks",
        partner_independent=True,
    ),
    "ground_penetration": Metric(
        "Below ground",
        LOWER,
        "m",
        "mean depth of the lowest joint below the ground",
        tolerance=1.0,
        partner_independent=True,
    ),
    "bone_variation": Metric(
        "Bone variation",
        LOWER,
        "",
        "standard deviation of a bone's length over time, by its mean",
        partner_independent=True,
    ),
    "jerk": Metric(
        "Jerk",
        CLOSER_TO_REAL,
        "m/s³",
        "third derivative of joint positions, smoothed",
        partner_independent=True,
    ),
    "jolts": Metric(
        "Jolts",
        LOWER,
        "",
        "share of reactions with a joint of greater acceleration than in any real one",
        is_share=True,
        tolerance=1.0,
        exact_for_real=True,
        partner_independent=True,
    ),
    "lurches": Metric(
        "Lurches",
        LOWER,
        "",
        "share of reactions whose trunk or pelvis goes off and back within a third of a second, "
        "farther than in 95 % of the real ones",
        is_share=True,
        tolerance=1.0,
        partner_independent=True,
    ),
    "penetration": Metric(
        "Penetration",
        CLOSER_TO_REAL,
        "m",
        "mean depth by which the bodies' capsules overlap",
    ),
    "multimodality": Metric(
        "Multimodality", UNKNOWN, "", "distance of the features of reactions to one partner"
    ),
    "ape": Metric(
        "APE", LOWER, "m", "average position error of the root", tolerance=0.1, exact_for_real=True
    ),
    "ave": Metric(
        "AVE", LOWER, "m²", "average error of the root's variance over time", exact_for_real=True
    ),
    "ape_joints": Metric(
        "APE, joints", LOWER, "m", "average position error of all joints", exact_for_real=True
    ),
    "ave_joints": Metric(
        "AVE, joints", LOWER, "m²", "average variance error of all joints", exact_for_real=True
    ),
    "f2id_published": Metric("F²ID", LOWER, "", "1,000 samples with replacement, five times"),
    "diversity_published": Metric("Diversity", CLOSER_TO_REAL, "", "over 500 disjoint pairs"),
    "mmd_a_published": Metric("MMD-A", LOWER, "", "biased, many bandwidths; at least 2/n"),
    "mmd_s_published": Metric("MMD-S", LOWER, "", "biased, many bandwidths; at least 2/n"),
    "e_r": Metric("E_r", LOWER, "", "reconstruction error", tolerance=0.15),
    "e_b": Metric("E_b", LOWER, "", "error of bone lengths"),
    "jpd": Metric(
        "JPD",
        LOWER,
        "",
        "difference of the distances between the two bodies' joints",
        tolerance=0.15,
    ),
}

# The columns of each table; reports/details.json holds every metric.
MAIN_COLUMNS = ("f2id", "f2id_excess", "mmd_a", "mmd_s", "diversity", "ape")
PARTNER_COLUMNS = (
    *("contacts_met", "false_contacts", "matching", "energy_score", "dispersion"),
    *("f2id_distances", "mmd_pair", "ape_joints"),
)
CONTACT_COLUMNS = ("contacts_met", "contacts_met_near", "false_contacts", "contact_f1")
PLAUSIBILITY_COLUMNS = (
    *("foot_skate", "step_length", "ground_penetration", "bone_variation"),
    *("jerk", "jolts", "lurches", "penetration"),
)
FURTHER_COLUMNS = ("multimodality", "f2id_infinity", "ave")
PUBLISHED_COLUMNS = (
    *("f2id_published", "diversity_published", "mmd_a_published", "mmd_s_published"),
    *("ape", "ave"),
)

ROWS = {
    "real": (
        "Real motion",
        "a second sample of real motion (noise floor); otherwise the tested pairs",
    ),
    "oracle": ("Oracle", "sampled from the true distribution: the best possible score"),
    "mean": ("Mean motion", "the mean of all training reactions, for every partner"),
    "nearest_neighbour": (
        "Nearest neighbour",
        "copy of the training reaction of the nearest training partner, re-timed",
    ),
    "nearest_neighbour_finished": (
        "Nearest neighbour, finished",
        "the same copy, finished as the models' reactions are",
    ),
    "pacmo": ("PaCMO", ""),
    "pacmo_without_finish": ("PaCMO without finish", "as the model generates them"),
    "no_critic": ("PaCMO without critic", "trained on the energy score alone"),
    "no_noise": ("PaCMO without noise", "its loss without critic, on one reaction to a partner"),
    "no_energy_score": ("PaCMO without energy score", "trained by the critic alone"),
    "no_body_distances": ("PaCMO without distances", "its critic is given no distances of bodies"),
    "no_contact_score": ("PaCMO without contact score", "trained on the score of the motion alone"),
    "no_augmentation": ("PaCMO without data augmentation", ""),
    "pacmo_augmented": ("PaCMO, augmented", "trained on clips and their variations"),
    "pacmo_paper": ("PaCMO, as in the paper", "adversarial training alone"),
    "pacmo_paper_without_finish": ("PaCMO, as in the paper, without finish", ""),
    "regression": ("Regression", "the same operator, trained to predict one reaction"),
    "regression_without_finish": ("Regression without finish", "as the model generates them"),
    "gru": ("GRU", "baseline"),
    "gru_without_finish": ("GRU without finish", "as the model generates them"),
    "flow_matching": ("Flow matching", "the same operator, trained on the velocity of a flow"),
    "flow_matching_without_finish": ("Flow matching without finish", "as the model generates them"),
    "wrong_partner": ("Wrong partner", "real reactions, permuted among partners"),
    "real_pairs": ("Real pairs", "the tested pairs"),
    "pacmo_permuted": ("PaCMO, wrong partner", "its reactions, permuted among partners"),
    "real_pairs_same_action": ("Real pairs", "of actions performed in several clips"),
    "wrong_partner_same_action": (
        "Wrong partner, same action",
        "real reactions, permuted within each action",
    ),
    "pacmo_same_action": ("PaCMO", "of actions performed in several clips"),
    "pacmo_permuted_same_action": (
        "PaCMO, wrong partner, same action",
        "permuted within each action",
    ),
}
VARIANTS = (
    *("no_critic", "no_noise", "no_energy_score", "no_body_distances", "no_contact_score"),
    "no_augmentation",
)
UNTRAINED = ("mean", "nearest_neighbour", "nearest_neighbour_finished")
MODELS = (
    *(*UNTRAINED, "pacmo", "pacmo_without_finish", *VARIANTS),
    *("pacmo_augmented", "pacmo_paper", "pacmo_paper_without_finish"),
    *("regression", "regression_without_finish", "gru", "gru_without_finish"),
    *("flow_matching", "flow_matching_without_finish"),
)
# Models of which the report's first sentences speak.
HEADLINE_MODELS = (
    *("pacmo", "pacmo_augmented", "pacmo_paper", "regression", "gru", "flow_matching"),
)
# What a model has to beat, as far as a run has it.
BASELINES = (
    *("nearest_neighbour", "nearest_neighbour_finished"),
    *("regression", "no_critic", "gru", "flow_matching"),
)
MAIN_ROWS = ("real", "oracle", "wrong_partner", *MODELS, "pacmo_permuted")
SAME_ACTION_ROWS = (
    *("real_pairs_same_action", "wrong_partner_same_action"),
    *("pacmo_same_action", "pacmo_permuted_same_action"),
)
# Never marked as the best of a column: models are compared with these.
REFERENCE_ROWS = {name for name in ROWS if name not in MODELS}


def find_metric(name: str) -> Metric | None:
    """Return a metric of the catalogue; that of one action, ``METRIC.ACTION``, is its namesake."""
    base, _, action = name.partition(".")
    metric = METRICS.get(base)
    return replace(metric, label=action) if metric and action else metric


def improvement_sign(name: str) -> int:
    """Return −1 if lower is better, +1 if higher is, 0 if neither is by itself."""
    return {LOWER: -1, HIGHER: 1}.get(METRICS[name].better, 0)
