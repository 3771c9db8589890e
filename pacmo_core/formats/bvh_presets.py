"""What is known of each BVH data set and not in its files: who pairs with whom, units, up."""

from dataclasses import dataclass

from pacmo_core.formats.cmu_trials import trial_label
from pacmo_core.formats.pairing import PairRule

INCH = 0.0254


@dataclass(frozen=True, kw_only=True)
class BvhPreset:
    """Facts of one data set.

    Parameters
    ----------
    rules : how its paths pair; none where it holds single persons
    unit : metres a file unit; None where only the user knows
    raw_unit : the same for files in a folder ``raw`` or ``..._raw``
    up : the axis that is up, ``y`` or ``z``; None where only the user knows
    """

    rules: tuple[PairRule, ...]
    unit: float | None
    raw_unit: float | None
    up: str | None


# "Simulation and Retargeting of Complex Multi-Character Interactions" (Zhang et al. 2023). What
# follows the person's tag names a cut (_short, _part, _crawl): a cut is part of its recording.
_DUO = r"(?P<folder>(?:.*/)?){recording}_(?P<person>{persons})(?P<cut>(?:_[^/]*)?)\.(?i:bvh)"
DUO_MOCAP = BvhPreset(
    rules=(
        PairRule(
            pattern=_DUO.format(recording=r"(?P<recording>[^/]+?_\d+)", persons="female|male"),
            persons=("female", "male"),
            name="{folder}{recording}{cut}",
            recording="{recording}",
            action="salsa",
            subjects=("salsa-female", "salsa-male"),
        ),
        PairRule(
            pattern=_DUO.format(
                recording=r"(?P<recording>(?P<action>[^/]+?)_?\d*)", persons="S1|S2"
            ),
            persons=("S1", "S2"),
            name="{folder}{recording}{cut}",
            recording="{recording}",
            action="{action}",
            subjects=("S1", "S2"),
        ),
    ),
    unit=1.0,
    raw_unit=INCH,
    up="z",
)

# CMU's two-person trials as AMASS fits. Both folders spell a trial with person a's number, and
# the same two people are subjects 18 and 19, 20 and 21, 22 and 23: a split by person must know.
CMU_18_19 = BvhPreset(
    rules=(
        PairRule(
            pattern=r"(?P<folder>(?:.*/)?)(?P<a>\d\d)_(?P<b>\d\d)_(?P<person>Justin|rory)"
            r"/(?P<trial>(?P=a)_\d\d)_poses\.(?i:bvh)",
            persons=("Justin", "rory"),
            name="{folder}{a}_{b}/{trial}",
            recording="{trial}",
            action="{trial}",
            subjects=("Justin", "rory"),
            label=trial_label,
        ),
        PairRule(
            pattern=r"(?P<folder>(?:.*/)?)(?P<person>60|61)_(?P<trial>\d\d)_poses\.(?i:bvh)",
            persons=("60", "61"),
            name="{folder}60_61_{trial}",
            recording="60_{trial}",
            action="60_{trial}",
            subjects=("60", "61"),
            label=trial_label,
        ),
    ),
    unit=1.0,
    raw_unit=None,
    up="z",
)

# Sample of "Two-Person Interaction Augmentation with Skeleton Priors" (Li et al. 2024): one
# character without a partner. The unit is not stated; 2.1 cm gives a grown-up's height.
SKELETON_PRIORS = BvhPreset(rules=(), unit=0.021, raw_unit=None, up="y")

# An animator's own files.
PAIR = BvhPreset(
    rules=(
        PairRule(
            pattern=r"(?P<name>.*[^/])_(?P<person>A|B)\.(?i:bvh)",
            persons=("A", "B"),
            name="{name}",
            recording="{name}",
            action="",
            subjects=("", ""),
        ),
    ),
    unit=None,
    raw_unit=None,
    up=None,
)

PRESETS = {
    "duo_mocap": DUO_MOCAP,
    "cmu_18_19": CMU_18_19,
    "skeleton_priors": SKELETON_PRIORS,
    "pair": PAIR,
}
