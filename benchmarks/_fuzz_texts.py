"""Random text captures for ``benchmarks.robustness``: drawn from the formats' grammars.

Every draw takes a ``Grammar``, which with a probability of its own puts something odd where the
format has a number, a name or a line: so cases reach from valid files to noise.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

ODD_NUMBERS = (
    *("nan", "-inf", "1e400", "1e38", "-1e9", "x", "", "1_0", "0x1F", "1,5", "2147483648", "--1"),
    *("٣", "１.５", "1e-400", "0", "9" * 400, "1e5e5", "+", ".", "é", "\x00", "\x1b[2J", "1d3"),
)
ODD_NAMES = (
    *("", "../../x", "/tmp/x", "\x1b[31m", "a b", "{", "}", "root", "Site", "é", "ＪＯＩＮＴ", "#"),
    *("x" * 3000, "OFFSET", "begin", "end", ":root", "\x00", "\u202e", "joint", "-1"),
)


class Grammar:
    """Random draws of one case.

    Parameters
    ----------
    random : of the case
    """

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self.oddity = float(random.choice([0, 0.0005, 0.005, 0.05, 0.4]))

    def odd(self) -> bool:
        """Whether something odd comes now."""
        return bool(self.random.random() < self.oddity)

    def pick(self, words: tuple[str, ...]) -> str:
        """Draw one of some words."""
        return words[int(self.random.integers(len(words)))]

    def integer(self, low: int, high: int) -> int:
        """Draw a whole number from ``low`` to below ``high``."""
        return int(self.random.integers(low, high))

    def number(self, scale: float = 1.0) -> str:
        """Draw a number, or something odd."""
        if self.odd():
            return self.pick(ODD_NUMBERS)
        return f"{scale * self.random.standard_normal():.{self.integer(0, 7)}f}"

    def count(self, n: int) -> str:
        """Write a count, or something odd or near."""
        if not self.odd():
            return str(n)
        return self.pick((*ODD_NUMBERS, str(n + 1), str(n - 1), f"-{n}", f"0{n}", f"{n}.0"))

    def name(self, number: int) -> str:
        """Name a thing by its number, or oddly."""
        return self.pick(ODD_NAMES) if self.odd() else f"name{number}"

    def numbers(self, n: int, scale: float, delimiter: str = " ") -> str:
        """Draw a row of numbers, rarely one too many or too few."""
        n += self.integer(-1, 2) if self.odd() else 0
        return delimiter.join(self.number(scale) for _ in range(n))

    def lines(self, lines: list[str]) -> str:
        """Join lines, each of which may be lost, doubled, moved or blank."""
        result: list[str] = []
        for line in lines:
            copies = self.integer(0, 3) if self.odd() else 1
            result += [line] * copies + [self.pick(("", "\t", "\x0c", "# x", "}"))] * self.odd()
        if self.odd():
            self.random.shuffle(result)
        ending = self.pick(("\r\n", "\r", "\x0b", "\u2028")) if self.odd() else "\n"
        return ending.join(result) + ending * (not self.odd())


def bvh(grammar: Grammar) -> str:
    """Draw one person as BVH: a random tree, random channels, random motion."""
    lines, widths = ["HIERARCHY"], list[int]()
    depth = grammar.integer(1, 6)
    _joint(grammar, lines, widths, grammar.pick(("ROOT", "root")), depth)
    frames = grammar.integer(0, 40) if grammar.odd() else grammar.integer(2, 12)
    lines += ["MOTION", f"Frames: {grammar.count(frames)}"]
    lines.append(f"Frame Time: {grammar.number() if grammar.odd() else '0.0333333'}")
    lines += [grammar.numbers(sum(widths), 30) for _ in range(frames)]
    return grammar.lines(lines)


def _joint(g: Grammar, lines: list[str], widths: list[int], word: str, depth: int) -> None:
    lines += [f"{word} {g.name(len(widths))}", "{", f"OFFSET {g.numbers(3, 0.3)}"]
    names = g.random.permutation(["Xrotation", "Yrotation", "Zrotation"]).tolist()
    if word.lower() == "root" or g.random.random() < 0.1:
        names = ["Xposition", "Yposition", "Zposition", *names]
    names = names[: g.integer(0, 7)] if g.odd() else names
    lines.append(f"CHANNELS {g.count(len(names))} {' '.join(names)}")
    widths.append(len(names))
    for _ in range(g.integer(1, 4) if depth > 1 and len(widths) < 30 else 0):
        _joint(g, lines, widths, "JOINT", depth - 1)
    if depth == 1:
        lines += ["End Site", "{", f"OFFSET {g.numbers(3, 0.3)}", "}"]
    lines.append("}")


def asf(grammar: Grammar, n_bones: int) -> tuple[str, list[tuple[str, int]]]:
    """Draw a skeleton; also its moving bones with their numbers of degrees of freedom."""
    lines = [":version 1.10", ":units", f"length {grammar.count(1)}", "angle deg", ":root"]
    order = " ".join(grammar.random.permutation(["TX", "TY", "TZ", "RX", "RY", "RZ"]))
    lines += [f"order {order}", "axis XYZ", "position 0 0 0", "orientation 0 0 0", ":bonedata"]
    names = [grammar.name(number) for number in range(n_bones)]
    moving = [("root", 6)]
    for name in names:
        dof = ["rx", "ry", "rz"][: grammar.integer(0, 4)]
        lines += ["begin", f"name {name}", f"direction {grammar.numbers(3, 1)}"]
        axis = "".join(grammar.random.permutation(list("XYZ")))
        lines += [f"length {grammar.number(3)}", f"axis {grammar.numbers(3, 30)} {axis}"]
        lines += ([f"dof {' '.join(dof)}"] if dof else []) + ["end"]
        moving += [(name, len(dof))] if dof else []
    lines += [":hierarchy", "begin"]
    parents = ["root", *names]
    lines += [f"{parents[grammar.integer(0, i + 1)]} {name}" for i, name in enumerate(names)]
    return grammar.lines([*lines, "end"]), moving


def amc(grammar: Grammar, moving: list[tuple[str, int]]) -> str:
    """Draw the motion of some bones."""
    lines = [":FULLY-SPECIFIED", ":RADIANS" if grammar.odd() else ":DEGREES"]
    for frame in range(1, grammar.integer(2, 12)):
        lines.append(grammar.count(frame))
        lines += [f"{name} {grammar.numbers(width, 20)}" for name, width in moving]
    return grammar.lines(lines)


def ntu(grammar: Grammar) -> str:
    """Draw an NTU file of up to four bodies, some with gaps."""
    n_frames = grammar.integer(2, 10)
    lines = [grammar.count(n_frames)]
    bodies = grammar.integer(0, 5) if grammar.odd() else 2
    for _ in range(n_frames):
        shown = [body for body in range(bodies) if not grammar.odd()]
        lines.append(grammar.count(len(shown)))
        for body in shown:
            lines += [f"{grammar.count(72057594037900000 + body)} {grammar.numbers(9, 1)}"]
            lines.append(grammar.count(25))
            lines += [grammar.numbers(12, 1) for _ in range(25)]
    return grammar.lines(lines)


def rows(grammar: Grammar, n_numbers: int, *, header: str = "", numbered: bool = True) -> str:
    """Draw a table of numbers, separated by commas."""
    lines = [header] if header else []
    for frame in range(1, grammar.integer(2, 14)):
        index = f"{grammar.count(frame)}," if numbered else ""
        lines.append(index + grammar.numbers(n_numbers, 1, ","))
    return grammar.lines(lines)


def _write(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(text.encode("utf-8", "surrogatepass"))


def write_bvh(grammar: Grammar, folder: Path) -> None:
    """Write two people as BVH, mostly the same text with other numbers."""
    text = bvh(grammar)
    _write(folder / "wave_A.bvh", text)
    _write(folder / "wave_B.bvh", bvh(grammar) if grammar.odd() else text)


def write_cmu(grammar: Grammar, folder: Path) -> None:
    """Write a trial of two subjects."""
    skeleton, moving = asf(grammar, grammar.integer(1, 12))
    motion = amc(grammar, moving)
    for subject in ("18", "19"):
        _write(folder / subject / f"{subject}.asf", skeleton)
        _write(folder / subject / f"{subject}_01.amc", motion)


def write_ntu(grammar: Grammar, folder: Path) -> None:
    """Write one NTU file."""
    _write(folder / "S001C001P001R001A050.skeleton", ntu(grammar))


def write_sbu(grammar: Grammar, folder: Path) -> None:
    """Write one take of SBU."""
    _write(folder / "s01s02" / "01" / "001" / "skeleton_pos.txt", rows(grammar, 90))


def write_duetdance(grammar: Grammar, folder: Path) -> None:
    """Write two dancers as text."""
    for sex in ("male", "female"):
        _write(folder / sex / "04" / "001" / "skeleton_pos.txt", rows(grammar, 45))


def write_expi(grammar: Grammar, folder: Path) -> None:
    """Write one action of ExPI."""
    header = ",".join(grammar.name(i) for i in range(108))
    text = rows(grammar, 108, header=header, numbered=False)
    _write(folder / "acro1" / "a-frame1" / "mocap_cleaned.tsv", text)


def write_table(grammar: Grammar, folder: Path) -> None:
    """Write a table of the joints of two people."""
    names = [grammar.name(i) for i in range(3)]
    columns = [f"person_{p}.{name}.{axis}" for p in "ab" for name in names for axis in "xyz"]
    lines = [
        f"# fps: {grammar.count(30)}",
        f"# unit: {grammar.count(1)}",
        f"# up: {'x' if grammar.odd() else grammar.pick(('y', 'z'))}",
        f"# parents: -1 {grammar.count(0)} {grammar.count(1)}",
        ",".join(["frame", "time", *columns]),
    ]
    for frame in range(grammar.integer(2, 14)):
        time = "x" if grammar.odd() else f"{frame / 30:.9f}"
        lines.append(f"{grammar.count(frame)},{time},{grammar.numbers(18, 1, ',')}")
    _write(folder / "wave.csv", grammar.lines(lines))


TEXTS: dict[str, Callable[[Grammar, Path], None]] = {
    "bvh": write_bvh,
    "cmu": write_cmu,
    "ntu": write_ntu,
    "sbu": write_sbu,
    "duetdance": write_duetdance,
    "expi": write_expi,
    "table": write_table,
}
