"""Faults that a BVH file can have, each with what must be said of it."""

from tests.formats.valid_sets import BVH_HIERARCHY, bvh_text

VALID = bvh_text(seed=3)


def nested(depth: int) -> str:
    opening = "".join(f"JOINT j{i}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n" for i in range(depth))
    return BVH_HIERARCHY.replace("  JOINT Spine\n", f"{opening}JOINT Spine\n", 1)


ROWS = VALID.split("Frame Time: 0.033333\n")[1]
FAULTS = [
    ("", "empty"),
    ("\n \n", "empty"),
    (b"\x00\x01\x02", "wanted HIERARCHY"),
    (b"HIERARCHY\nROOT \xff\n", r":2: wanted UTF-8 text; got the byte 0xff"),
    ("MOTION\n", "wanted HIERARCHY; got 'MOTION'"),
    (BVH_HIERARCHY, "ends before MOTION"),
    (VALID.split("  JOINT")[0], "ends before MOTION"),
    (VALID.replace("OFFSET 0.3 0 0", "OFFSET 0.3 0"), ":16: wanted one OFFSET of 3 numbers; got 2"),
    (VALID.replace("OFFSET 0.3 0 0", "OFFSET 0.3 0 x"), ":16: wanted a number; got 'x'"),
    (VALID.replace("    OFFSET 0 0.5 0\n", ""), ":31: Spine has no OFFSET"),
    (VALID.replace("    CHANNELS 3 Xrotation Yrotation Zrotation\n", ""), "Spine has no CHANNELS"),
    (VALID.replace("CHANNELS 3 X", "CHANNELS 999999999999 X"), "as stated, 999999999999; got 3"),
    (VALID.replace("CHANNELS 3 X", "CHANNELS -3 X"), "as stated, -3; got 3"),
    (VALID.replace("3 Xrotation", "3 Wrotation"), "got 'wrotation'"),
    (VALID.replace("3 Xrotation", "3 Zrotation"), "got 'zrotation'"),
    (VALID.replace("}\nMOTION", "MOTION"), "MOTION while 1 braces are unclosed"),
    (VALID.replace("}\nMOTION", "}\n}\nMOTION"), "'}' is outside the ROOT"),
    (VALID.replace("JOINT Spine\n  {", "JOINT Spine"), "wanted '{'; got 'OFFSET'"),
    (VALID.replace("OFFSET 0 0.5 0", "{ OFFSET 0 0.5 0"), "'{' opens no joint"),
    (VALID.replace("RightArm", "LeftArm"), "wanted a new name for the joint; got 'LeftArm'"),
    (VALID.replace("JOINT Spine", "ROOT Spine"), "a second ROOT, 'Spine'"),
    (VALID.replace("JOINT Spine", "JOINT"), "wanted a new name"),
    (VALID.replace("JOINT Spine", "LIMB Spine"), "got 'LIMB'"),
    (VALID.replace("OFFSET 0.4 0 0", "JOINT x"), "an End Site holds no joints"),
    (VALID.replace("End Site", "End Sight", 1), "wanted 'End Site'"),
    (nested(5000) + "MOTION\n", "more than 1000 joints"),
    (VALID.replace("Frames: 6", "Frames: 7"), "the header says 7 frames, the file has 6 rows"),
    (VALID.replace("Frames: 6", "Frames: 5"), "the header says 5 frames, the file has 6 rows"),
    (VALID.replace("Frames: 6", "Frames: 9" * 8), "wanted a number"),
    (VALID.replace("Frames: 6", "Frames: 99999999999"), "wanted a number up to 1e+09"),
    (VALID.replace("Frames: 6\n", ""), "wanted 'Frames:'; got 'Frame Time: 0.033333'"),
    (VALID.replace("0.033333", "0"), "no capture has a Frame Time of 0 s"),
    (VALID.replace("0.033333", "nan"), "got 'nan'"),
    (VALID.replace(ROWS, ""), "says 6 frames, the file has 0 rows"),
    (VALID.replace(ROWS, "").replace("Frames: 6", "Frames: 0"), "no motion: 0 rows"),
    (VALID[:-20], r":42: wanted 16 numbers; got 14"),
    (VALID.replace(ROWS, "1 " + ROWS), r":37: wanted 16 numbers; got 17"),
    (VALID.replace("\n", " 1\n").replace(" 1\n", "\n", 36), ":37: wanted 16 numbers; got 17"),
    (VALID + "extra\n", "says 6 frames, the file has 7 rows"),
    (VALID.replace(ROWS, "1_0" + ROWS[ROWS.index(" ") :]), "got '1_0'"),
    (VALID.replace(ROWS, "inf" + ROWS[ROWS.index(" ") :]), ":37: wanted a number .* got 'inf'"),
    (VALID.replace(ROWS, "1.2.3" + ROWS[ROWS.index(" ") :]), ":37: wanted a number; got '1.2.3'"),
]
