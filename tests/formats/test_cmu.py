"""Truth: matrices multiplied one bone at a time, and an export of the same motion as BVH."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from pacmo_core.formats.acclaim import read_amc
from pacmo_core.formats.base import FormatError
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.cmu import CMU_FPS, CMU_LABELS, Cmu
from tests.formats.real_files import real_folder
from tests.formats.valid_sets import ASF, FRAMES, amc_text, write_cmu

AMC = amc_text(0)
UNIT = 0.0254 / 0.45


def read(folder: Path, asf: str = ASF, amc: str = AMC):
    (folder / "18.asf").write_text(asf)
    (folder / "18_01.amc").write_text(amc)
    return read_amc(folder / "18.asf", folder / "18_01.amc")


def euler(order: str, degrees) -> np.ndarray:
    """Turn about fixed axes, the first of ``order`` first: Rz·Ry·Rx for xyz."""
    return Rotation.from_euler(order, degrees, degrees=True).as_matrix()


def oracle(lines: dict[str, list[float]]) -> np.ndarray:
    """Compute one frame of ``ASF`` by hand."""
    root = euler("xyz", lines["root"][3:])
    c_femur, c_tibia = euler("xyz", (10, 20, 30)), euler("xyz", (0, 0, 20))
    femur = root @ c_femur @ euler("xyz", lines["lfemur"]) @ c_femur.T
    rx, rz = lines["ltibia"]
    tibia = femur @ c_tibia @ euler("xz", (rx, rz)) @ c_tibia.T
    hip = np.array(lines["root"][:3])
    joint = hip + root @ (1.2, -1.6, 0)
    knee = joint + femur @ (7 * np.array((0.34202, -0.939693, 0)))
    ankle = knee + tibia @ (7.5 * np.array((0, -1, 7.6e-16)))
    return np.array((hip, joint, knee, ankle)) * UNIT


def test_positions_are_those_of_one_frame_worked_by_hand(tmp_path):
    amc = read(tmp_path)
    assert amc.asf.joints == ("root", "lhipjoint", "lfemur", "ltibia")
    places = amc.positions()
    assert places.shape == (FRAMES, 4, 3)
    blocks = re.split(r"\r\n\d+\r\n", AMC)[1:]
    for place, block in zip(places, blocks, strict=True):
        words = [line.split() for line in block.strip().splitlines()]
        assert_allclose(place, oracle({w[0]: [float(x) for x in w[1:]] for w in words}), atol=1e-12)


def test_a_trial_is_two_subjects_at_the_rate_of_the_setting(tmp_path):
    write_cmu(tmp_path)
    form = Cmu(fps=CMU_FPS)
    (sequence,) = form.find(tmp_path)
    assert (sequence.name, sequence.subjects) == ("18_19_01", ("18", "19"))
    assert (sequence.action, sequence.recording) == ("walk, shake hands", "18_01")
    assert [f.name for f in sequence.files] == ["18_01.amc", "19_01.amc", "18.asf", "19.asf"]
    interaction = form.read(sequence).interaction
    assert interaction.fps == pytest.approx(120)
    assert interaction.person_a.shape == (FRAMES, 4, 3)
    assert (interaction.person_a != interaction.person_b).any()


def test_files_of_both_subjects_in_one_folder_pair_too(tmp_path):
    write_cmu(tmp_path / "deep")
    for file in (tmp_path / "deep").glob("*/*"):
        file.rename(tmp_path / file.name)
    assert [s.name for s in Cmu(fps=CMU_FPS).find(tmp_path)] == ["18_19_01"]


@pytest.mark.parametrize(
    ("gone", "reason"),
    [
        ("19/19_01.amc", "no second person"),
        ("19/19.asf", "19.asf: cannot be read: No such file"),
    ],
)
def test_a_missing_file_is_a_reason(tmp_path, gone, reason):
    write_cmu(tmp_path)
    (tmp_path / gone).unlink()
    form = Cmu(fps=CMU_FPS)
    (sequence,) = form.find(tmp_path)
    with pytest.raises(FormatError, match=reason):
        form.read(sequence)


def test_a_subject_without_a_rate_is_refused(tmp_path):
    write_cmu(tmp_path)
    form = Cmu(fps={"18": 120.0})
    with pytest.raises(FormatError, match="no fps given for subject '19'"):
        form.read(form.find(tmp_path)[0])


@pytest.mark.parametrize(
    ("asf", "amc", "reason"),
    [
        ("", AMC, "18.asf: the file is empty"),
        (ASF.replace(":hierarchy", ":tree"), AMC, "the section :hierarchy is missing"),
        (ASF.replace("length 0.45", "length 0"), AMC, "18.asf:6: wanted a length unit of 0.001"),
        (ASF.replace("length 0.45", "length 1e-320"), AMC, "wanted a length unit"),
        (ASF.replace("angle deg", "angle rad"), AMC, r"wanted angles in deg; got \['rad'\]"),
        (ASF.replace("TX TY TZ", "TX TY"), AMC, "wanted a root order"),
        (ASF.replace("position 0 0 0", "position 1 0 0"), AMC, "wanted a root at rest"),
        (
            ASF.replace("length 7\n", "length seven\n"),
            AMC,
            "18.asf:25: wanted a number; got 'seven'",
        ),
        (ASF.replace("length 7\n", ""), AMC, "wanted length with 1 numbers"),
        (ASF.replace("30  XYZ", "30  XXZ"), AMC, "wanted an axis order such as XYZ; got 'XXZ'"),
        (ASF.replace("dof rx ry rz", "dof rx rx"), AMC, "wanted dof of rx, ry, rz"),
        (ASF.replace("  end\n  begin", "  begin", 1), AMC, "wanted a bone's begin and end"),
        (ASF.replace("name ltibia", "name lfemur"), AMC, "wanted a new bone; got 'lfemur'"),
        (ASF.replace("lfemur ltibia", "ltibia lfemur"), AMC, "cannot be the parent of 'lfemur'"),
        (ASF.replace("    lfemur ltibia\n", ""), AMC, "the hierarchy holds 2 of 3 bones"),
        (ASF, "", "18_01.amc: the file is empty"),
        (ASF, ":DEGREES\n", "the file has no frames"),
        (ASF, AMC.replace(":DEGREES", ":RADIANS"), "got :RADIANS"),
        (ASF, AMC.replace("ltibia", "tibia"), r"first frame lacks \['ltibia'\]"),
        (ASF, AMC.replace("\r\n2\r\n", "\r\n3\r\n"), r"18_01.amc:8: wanted the line '2'; got '3'"),
        (ASF, AMC.replace("\r\n1\r\n", "\r\none\r\n"), "wanted a frame's number; got 'one'"),
        (ASF, "ltibia 0 1\r\n" + AMC, "first frame lacks"),
        (ASF, AMC + "7\r\n", r"the last frame has 1 of 4 lines"),
        (ASF, AMC.replace("-1.03865e-014", "x", 1), "18_01.amc:7: wanted a number; got 'x'"),
        (ASF, AMC.replace(" -1.03865e-014", "", 1), "18_01.amc:7: wanted 2 numbers; got 1"),
        (ASF, AMC.replace("-1.03865e-014", "nan", 1), "18_01.amc:7: wanted a number up to"),
    ],
)
def test_a_faulty_file_is_refused_with_its_line_and_the_reason(tmp_path, asf, amc, reason):
    with pytest.raises(FormatError, match=reason):
        read(tmp_path, asf, amc)


def test_the_index_labels_every_trial_of_a_pair():
    assert len(CMU_LABELS) == 15 + 13 + 25 + 2 + 15
    assert CMU_LABELS["20_11"] == "high-five, walk"
    assert CMU_LABELS["22_25"] == "walk; A catches wallet thrown by B"


def far_ends(bvh: Bvh) -> np.ndarray:
    """Place each joint with its own turn, not its parent's.

    The export hangs a bone's turn on the joint at the bone's far end, so the format's rule would
    turn every bone by its parent's angles; the angles themselves are an independent computation.
    """
    turns: list[np.ndarray] = []
    places = np.zeros((len(bvh.motion), len(bvh.joints), 3))
    first = 0
    for joint, parent in enumerate(bvh.parents):
        names = [name[0].upper() for name in bvh.channels[joint] if name.endswith("rotation")]
        last = first + len(bvh.channels[joint])
        turn = np.broadcast_to(np.eye(3), (len(bvh.motion), 3, 3))
        if names:
            angles = bvh.motion[:, last - 3 : last]
            turn = Rotation.from_euler("".join(names), angles, degrees=True).as_matrix()
        turns.append(turns[parent] @ turn if parent >= 0 else turn)
        above = places[:, parent] if parent >= 0 else bvh.motion[:, :3]
        places[:, joint] = above + turns[joint] @ bvh.offsets[joint]
        first = last
    return places


def test_real_motion_agrees_with_an_export_of_it_to_a_hundredth_of_a_millimetre():
    folder = real_folder("cmu_raw")
    amc = read_amc(folder / "60.asf", folder / "60_01.amc")
    bvh = read_bvh(folder / "cmu_60_01.bvh")
    exported = far_ends(bvh)[:, [bvh.joints.index(joint) for joint in amc.asf.joints]]
    assert_allclose(amc.positions(), exported * UNIT, atol=1e-5)


def test_real_motion_agrees_with_body_fits_to_its_markers():
    # The fits' world is (z, x, y) of CMU's, every second frame, and displaced by a constant.
    folder = real_folder("cmu_raw")
    fits = read_bvh(real_folder("cmu_18_19") / "not_a_pair" / "60_01_poses.bvh")
    there = fits.positions()[..., [1, 2, 0]]
    amc = read_amc(folder / "60.asf", folder / "60_01.amc")
    here = amc.positions()[::2]
    there = there - (there[:, 0] - here[:, 0]).mean(0)
    for ours, theirs in (("lfemur", "lknee"), ("rfemur", "rknee"), ("rtibia", "rankle")):
        a = here[:, amc.asf.joints.index(ours)]
        b = there[:, fits.joints.index(theirs)]
        assert np.linalg.norm(a - b, axis=-1).mean() < 0.08


def test_real_single_persons_are_listed_and_refused():
    form = Cmu(fps=CMU_FPS)
    for sequence in form.find(real_folder("cmu_raw")):
        with pytest.raises(FormatError, match="no second person"):
            form.read(sequence)
