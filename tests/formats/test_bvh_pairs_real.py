"""Truth: what the datasets say of themselves: metres, two people, feet on the ground."""

import numpy as np
import pytest

from pacmo_core.formats.base import FormatError, RawSequence
from pacmo_core.formats.bvh_pairs import BvhPairs
from tests.formats.real_files import real_folder


def pairs(preset: str) -> BvhPairs:
    plain = {"unit": None, "up": None, "fps": None, "max_root_distance": None}
    return BvhPairs(preset=preset, end_sites=False, skip_frames=0, **plain)


def reason(form: BvhPairs, sequence: RawSequence) -> str:
    with pytest.raises(FormatError) as caught:
        form.read(sequence)
    return str(caught.value)


def test_real_salsa_is_two_upright_grown_ups_near_each_other():
    form = pairs("duo_mocap")
    found = {s.name: s for s in form.find(real_folder("duo_mocap"))}
    interaction = form.read(found["salsa/Easy_01_30fps"]).interaction
    joints = list(interaction.skeleton.joints)
    assert interaction.fps == pytest.approx(30, abs=0.01)
    for person in (interaction.person_a, interaction.person_b):
        feet = person[:, [joints.index("LeftToeBase"), joints.index("RightToeBase")], 1]
        assert abs(np.median(feet.min(1)) - 0.02) < 0.02
        assert 1.3 < np.median(person[:, joints.index("Head"), 1]) < 1.8
        # With y up and right-handed, (left - right) x up points forward, as toes do.
        across = person[:, joints.index("LeftUpLeg")] - person[:, joints.index("RightUpLeg")]
        toes = person[:, joints.index("LeftToeBase")] - person[:, joints.index("LeftFoot")]
        assert ((np.cross(across, (0, 1, 0)) * toes).sum(-1) > 0).mean() > 0.99
    apart = np.linalg.norm(interaction.person_a[:, 0] - interaction.person_b[:, 0], axis=-1)
    assert 0.4 < np.median(apart) < 0.8


def test_real_raw_files_in_inches_are_the_same_motion_in_metres():
    form = pairs("duo_mocap")
    found = {s.name: s for s in form.find(real_folder("duo_mocap"))}
    cut = form.read(found["salsa/Easy_01_30fps"]).interaction
    raw = form.read(found["salsa_raw/Easy_01"]).interaction
    assert raw.skeleton == cut.skeleton
    nearest = np.abs(raw.times[None] - cut.times[:, None]).argmin(1)
    error = np.linalg.norm(raw.person_b[nearest] - cut.person_b, axis=-1)
    assert np.median(error) < 0.01


def test_real_faulty_files_are_refused_with_the_reason():
    form = pairs("duo_mocap")
    found = {s.name: s for s in form.find(real_folder("duo_mocap"))}
    crawl = reason(form, found["faulty/jump_crawl001_S2_crawl_30fps.bvh"])
    assert "the header says 684 frames, the file has 774 rows" in crawl
    assert "no second person" in reason(form, found["faulty/ROM_30fps.bvh"])


def test_real_cmu_trials_pair_across_folders_and_know_their_labels():
    form = pairs("cmu_18_19")
    found = {s.name: s for s in form.find(real_folder("cmu_18_19"))}
    assert sum(len(s.files) == 2 for s in found.values()) == 13
    shake, same = found["18_19/18_01"], found["not_a_pair/60_61_01"]
    assert (shake.action, shake.subjects) == ("walk, shake hands", ("Justin", "rory"))
    interaction = form.read(shake).interaction
    assert interaction.person_a[..., 1].min() == pytest.approx(0.05, abs=0.01)
    # The second of these "pairs" is the same dancer twice: reading it is not the place to judge.
    twice = form.read(same).interaction
    assert np.linalg.norm(twice.person_a[:, 0] - twice.person_b[:, 0], axis=-1).mean() < 0.02
    for orphan in ("18_19_Justin/18_02_poses.bvh", "18_19_rory/18_12_poses.bvh"):
        assert "no second person" in reason(form, found[orphan])


def test_real_single_persons_are_listed_and_refused():
    form = pairs("skeleton_priors")
    sequences = form.find(real_folder("skeleton_priors"))
    assert len(sequences) == 10
    assert all("no second person" in reason(form, sequence) for sequence in sequences)
