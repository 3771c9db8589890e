"""Two people in two BVH files: one interaction.

Two files named outright need no rule: ``read`` takes any sequence that holds them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import Skeleton, mirror_by_name
from pacmo_core.formats.base import (
    MAX_DISTANCE,
    FormatError,
    Person,
    RawSequence,
    Reading,
    check_fps,
    check_up,
    pair_people,
    to_y_up,
)
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.cmu import trial_label
from pacmo_core.formats.pairing import PairRule, pair_files, unpaired_text
from pacmo_core.formats.scene_nodes import SceneNodes

INCH = 0.0254


@dataclass(frozen=True, kw_only=True)
class BvhPreset:
    """Settings of one dataset.

    Parameters
    ----------
    rules : how its paths pair; empty for single persons
    unit : metres per file unit; None if only the user knows
    raw_unit : the same for files in a folder ``raw`` or ``..._raw``
    up : the axis that is up, ``y`` or ``z``; None if only the user knows
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
            example="salsa/Easy_01_female.bvh and salsa/Easy_01_male.bvh",
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
            example="hug001_S1.bvh and hug001_S2.bvh",
        ),
    ),
    unit=1.0,
    raw_unit=INCH,
    up="z",
)

# CMU's two-person trials as AMASS fits. Both folders spell a trial with person a's number, and
# the same two people are subjects 18 and 19, 20 and 21, 22 and 23: a split by person must know.
# The folders of some pairs are delivered as Justin1 or Rory.
CMU_18_19 = BvhPreset(
    rules=(
        PairRule(
            pattern=r"(?P<folder>(?:.*/)?)(?P<a>\d\d)_(?P<b>\d\d)_(?P<person>(?i:justin|rory))\d?"
            r"/(?P<trial>(?P=a)_\d\d)_poses\.(?i:bvh)",
            persons=("Justin", "rory"),
            name="{folder}{a}_{b}/{trial}",
            recording="{trial}",
            action="{trial}",
            subjects=("Justin", "rory"),
            label=trial_label,
            example="20_21_Justin/20_01_poses.bvh and 20_21_rory/20_01_poses.bvh",
        ),
        PairRule(
            pattern=r"(?P<folder>(?:.*/)?)(?P<person>60|61)_(?P<trial>\d\d)_poses\.(?i:bvh)",
            persons=("60", "61"),
            name="{folder}60_61_{trial}",
            recording="60_{trial}",
            action="60_{trial}",
            subjects=("60", "61"),
            label=trial_label,
            example="60_01_poses.bvh and 61_01_poses.bvh",
        ),
    ),
    unit=1.0,
    raw_unit=None,
    up="z",
)

# Sample of "Two-Person Interaction Augmentation with Skeleton Priors" (Li et al. 2024): one
# character without a partner. The unit is not stated; 2.1 cm gives a grown-up's height.
SKELETON_PRIORS = BvhPreset(rules=(), unit=0.021, raw_unit=None, up="y")

# For files of the user.
PAIR = BvhPreset(
    rules=(
        PairRule(
            pattern=r"(?P<name>.*[^/])_(?P<person>A|B)\.(?i:bvh)",
            persons=("A", "B"),
            name="{name}",
            recording="{name}",
            action="",
            subjects=("", ""),
            example="NAME_A.bvh and NAME_B.bvh",
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


def unstated_settings(preset: str, settings: Mapping[str, Any]) -> list[str]:
    """List ``unit`` and ``up``, if neither the settings nor the preset state them."""
    if preset not in PRESETS:
        return []
    return [
        name
        for name in ("unit", "up")
        if settings.get(name) is None and getattr(PRESETS[preset], name) is None
    ]


Setting = TypeVar("Setting", str, float)


@dataclass(frozen=True, kw_only=True)
class BvhPairs:
    """Pairs of BVH files, one per person.

    Parameters
    ----------
    preset : the dataset: ``duo_mocap``, ``cmu_18_19``, ``skeleton_priors``, or ``pair`` for any
        files ``<name>_A.bvh`` and ``<name>_B.bvh``
    unit : metres per file unit; None for that of the preset
    up : up axis, ``y`` or ``z``; None for that of the preset
    fps : frame rate, if the files state a wrong Frame Time; None to use theirs
    end_sites : whether End Sites are joints. Some exports write them with zero length, which is
        no bone: a set that mixes both kinds has one skeleton only without them
    skip_frames : frames to leave out at the start, as where the first is a T-pose
    max_root_distance : remove the frames before the roots are this near (metres), such as
        those in which people walk in from a T-pose; None to keep everything

    Raises
    ------
    ValueError
        If the preset is unknown, or neither it nor the settings give the unit or the upward axis.
    """

    preset: str
    unit: float | None
    up: str | None
    fps: float | None
    end_sites: bool
    skip_frames: int
    max_root_distance: float | None

    def __post_init__(self) -> None:
        if self.preset not in PRESETS:
            raise ValueError(f"preset must be one of {', '.join(PRESETS)}; got {self.preset!r}")
        if not 0 < self._unit <= MAX_DISTANCE:
            raise ValueError(f"unit must be > 0 and <= {MAX_DISTANCE:g} metres; got {self._unit}")
        check_up(self.up_axis)
        if self.skip_frames < 0:
            raise ValueError(f"skip_frames must not be negative; got {self.skip_frames}")
        if self.fps is not None:
            check_fps(self.fps)

    def find(self, root: Path) -> list[RawSequence]:
        """List every pair under ``root``, and every BVH file that has no partner."""
        return pair_files(root, r".*\.bvh", self._facts.rules)

    def read(self, sequence: RawSequence) -> Reading:
        """Read both files.

        Raises
        ------
        FormatError
            If a file is broken (said first), the second is missing, or the two do not match.
        """
        people = [self._person(file) for file in sequence.files]
        if len(people) == 1:
            raise FormatError(sequence.files[0], unpaired_text(self._facts.rules))
        reading = pair_people(people)
        return replace(reading, interaction=self._met(sequence, reading.interaction))

    @property
    def _facts(self) -> BvhPreset:
        return PRESETS[self.preset]

    @property
    def _unit(self) -> float:
        return _setting_or_preset(self.preset, "unit", self.unit, self._facts.unit)

    @property
    def up_axis(self) -> str:
        """The axis that is up: ``y`` or ``z``."""
        return _setting_or_preset(self.preset, "up", self.up, self._facts.up)

    def _person(self, file: Path) -> Person:
        bvh = read_bvh(file)
        body = SceneNodes.of(bvh).body()
        skeleton = Skeleton(self.preset, body.joints, body.parents, mirror_by_name(body.joints))
        if self.end_sites:
            _check_end_sites(file, bvh)
        else:
            skeleton = skeleton.without(body.joints[end] for end in body.end_sites)
        rows = [bvh.joints.index(joint) for joint in skeleton.joints]
        positions = bvh.positions()[self.skip_frames :, rows]
        fps = 1 / bvh.frame_time if self.fps is None else self.fps
        return Person(file, skeleton, to_y_up(positions * self.metres(file), self.up_axis), fps)

    def metres(self, file: Path) -> float:
        """Return metres per unit: raw files of the same take may have another unit."""
        folder, raw_unit = file.parent.name, self._facts.raw_unit
        is_raw = folder == "raw" or folder.endswith("_raw")
        return raw_unit if self.unit is None and is_raw and raw_unit else self._unit

    def _met(self, sequence: RawSequence, interaction: Interaction) -> Interaction:
        """Remove the frames before the two people are near each other."""
        if self.max_root_distance is None:
            return interaction
        root = interaction.skeleton.root
        apart = interaction.person_a[:, root] - interaction.person_b[:, root]
        distance = np.linalg.norm(apart, axis=-1)
        near = distance[:-1] <= self.max_root_distance
        if not near.any():
            reason = f"the roots stay {distance.min():.2f} m apart; wanted {self.max_root_distance}"
            raise FormatError(sequence.files[0], reason)
        return interaction.frames(int(near.argmax()), len(interaction.times))


def _setting_or_preset(
    preset: str, name: str, setting: Setting | None, fact: Setting | None
) -> Setting:
    """Return the setting, or else the value of the preset; one of them must be given."""
    known = fact if setting is None else setting
    if known is None:
        raise ValueError(f"preset {preset} states no {name}: wanted it as a setting")
    return known


def _check_end_sites(file: Path, bvh: Bvh) -> None:
    """Refuse an End Site that lies on its joint: it would be a second name for it."""
    for end in bvh.end_sites:
        if not bvh.offsets[end].any():
            reason = f"{bvh.joints[end]} has zero length: read this set without End Sites"
            raise FormatError(file, reason)
