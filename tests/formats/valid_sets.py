"""One small valid set of each raw format, written after its description; also for other tests."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from pacmo_core.data.skeleton import SBU15
from pacmo_core.formats.write_tables import TABLE_WRITERS, JointTable

FRAMES = 6

# Channel orders differ, an End Site comes before its siblings, one joint has position channels.
BVH_HIERARCHY = """HIERARCHY
ROOT Hips
{
  OFFSET 0.1 0.2 0.3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Spine
  {
    OFFSET 0 0.5 0
    CHANNELS 3 Xrotation Yrotation Zrotation
    End Site
    {
      OFFSET 0 0.25 0.05
    }
    JOINT LeftArm
    {
      OFFSET 0.3 0 0
      CHANNELS 3 Yrotation Zrotation Xrotation
      End Site
      {
        OFFSET 0.4 0 0
      }
    }
    JOINT RightArm
    {
      OFFSET -0.3 0.05 0
      CHANNELS 4 Yposition Zrotation Yrotation Xrotation
      End Site
      {
        OFFSET -0.4 0 0
      }
    }
  }
}
"""
BVH_WIDTH = 16

ASF = """# a small body
:version 1.10
:name VICON
:units
  mass 1.0
  length 0.45
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name lhipjoint
     direction 0.6 -0.8 0
     length 2
     axis 0 0 0  XYZ
  end
  begin
     id 2
     name lfemur
     direction 0.34202 -0.939693 0
     length 7
     axis 10 20 30  XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
     id 3
     name ltibia
     direction 0 -1 7.6e-016
     length 7.5
     axis 0 0 20  XYZ
    dof rx rz
    limits (-10.0 170.0)
           (-70.0 20.0)
  end
:hierarchy
  begin
    root lhipjoint
    lhipjoint lfemur
    lfemur ltibia
  end
"""


def numbers(seed: int, *shape: int) -> NDArray[np.float64]:
    """Draw plausible places: up to a metre and a half from the origin, six decimals."""
    return np.random.default_rng(seed).uniform(-1.5, 1.5, shape).round(6)


def table(values: NDArray[np.float64], delimiter: str = " ") -> str:
    """Write rows of numbers."""
    return "".join(delimiter.join(f"{x:.6f}" for x in row) + "\n" for row in values)


def bvh_text(seed: int, frames: int = FRAMES) -> str:
    """Write one person as BVH."""
    motion = numbers(seed, frames, BVH_WIDTH)
    motion[:, 3:] *= 60
    return f"{BVH_HIERARCHY}MOTION\nFrames: {frames}\nFrame Time: 0.033333\n{table(motion)}"


def write_bvh_pair(root: Path) -> None:
    """Write ``wave_A.bvh`` and ``wave_B.bvh``: metres, y up, 30 fps."""
    root.mkdir(parents=True, exist_ok=True)
    for seed, person in enumerate("AB"):
        (root / f"wave_{person}.bvh").write_text(bvh_text(seed))


def amc_text(seed: int, frames: int = FRAMES) -> str:
    """Write one person's motion on ``ASF``; one number has a three-digit exponent."""
    lines = ["#!OML:ASF somewhere", ":FULLY-SPECIFIED", ":DEGREES"]
    for frame, row in enumerate(numbers(seed, frames, 11) * 10, start=1):
        words = [f"{x:.5f}" for x in row]
        words[-1] = "-1.03865e-014"
        lines += [str(frame), "root " + " ".join(words[:6])]
        lines += ["lfemur " + " ".join(words[6:9]), "ltibia " + " ".join(words[9:])]
    return "\r\n".join(lines) + "\r\n"


def write_cmu(root: Path) -> None:
    """Write trial 1 of subjects 18 and 19, a folder a subject, CRLF as published."""
    for seed, subject in enumerate(("18", "19")):
        folder = root / subject
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{subject}.asf").write_bytes(ASF.replace("\n", "\r\n").encode())
        (folder / f"{subject}_01.amc").write_bytes(amc_text(seed).encode())


def write_duetdance(root: Path) -> None:
    """Write two clips of one dance as MATLAB files."""
    for seed, sex in enumerate(("male", "female")):
        (root / sex).mkdir(parents=True, exist_ok=True)
        clips = {f"vid{i}_1": numbers(10 * seed + i, FRAMES + i, 15, 3) for i in (1, 2)}
        savemat(root / sex / "salsa.mat", clips)


def write_duetdance_text(root: Path) -> None:
    """Write one clip as text; the index starts at 2."""
    for seed, sex in enumerate(("male", "female")):
        folder = root / sex / "04" / "001"
        folder.mkdir(parents=True, exist_ok=True)
        places = table(numbers(seed, FRAMES, 45), ",").splitlines()
        text = "".join(f"{i},{row}\n" for i, row in enumerate(places, start=2))
        (folder / "skeleton_pos.txt").write_text(text)


def write_expi(root: Path) -> None:
    """Write one action of one pair: a header, then millimetres."""
    folder = root / "acro1" / "a-frame1"
    folder.mkdir(parents=True, exist_ok=True)
    header = ",".join(f"joint{i}_{axis}" for i in range(36) for axis in "xyz")
    text = f"{header}\n{table(numbers(0, FRAMES, 108) * 1000, ',')}"
    (folder / "mocap_cleaned.tsv").write_text(text)


def write_interhuman(root: Path) -> None:
    """Write one sequence: joints, then columns that no reader needs."""
    for seed, person in enumerate(("person1", "person2")):
        (root / person).mkdir(parents=True, exist_ok=True)
        np.save(root / person / "7.npy", numbers(seed, FRAMES, 70).astype(np.float32))


def write_tables(root: Path) -> None:
    """Write a table of joints of each kind, of different motions: metres, y up, 30 fps."""
    root.mkdir(parents=True, exist_ok=True)
    for seed, (suffix, write) in enumerate(TABLE_WRITERS.items()):
        people = list(numbers(seed, 2, FRAMES, 15, 3).astype(np.float32))
        table = JointTable(SBU15, np.arange(FRAMES) / 30, people, up="y", unit=1.0)
        (root / f"take{seed}{suffix}").write_bytes(write(table))
