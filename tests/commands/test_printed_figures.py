"""Truth: the files themselves, read again, against the same command's Parquet, which is exact.

What the commands print of BVH files is measured on the files, whatever command and format.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import app
from pacmo_core.commands.measured import Measured
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.skeleton import SBU15, Skeleton
from pacmo_core.figures.variations import MEASURES
from pacmo_core.formats.base import RawSequence
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.registry import DEFAULT_SETTINGS
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.formats.write_tables import TABLE_WRITERS, JointTable
from pacmo_core.store.motions import stream_motions, write_motions
from tests.augmentation.test_filter import LIMITS
from tests.commands.test_augment import CLIP
from tests.commands.test_react import weights as reaction_weights
from tests.commands.test_vary import weights as prior_weights

__all__ = ["prior_weights", "reaction_weights"]  # fixtures

PARAMS = Path("params.yaml").absolute()
CONTACT = 0.1
# Side by side, so near that some joints touch; noise, so that bones vary and BVH is not exact.
NOISE = np.random.default_rng(0).normal(scale=0.01, size=(2, *CLIP.person_a.shape))
OFFSET = (CLIP.person_a - CLIP.person_b).mean(axis=(0, 1)) + np.array([0.05, 0, 0.02])
PAIR = Interaction(
    SBU15,
    CLIP.times,
    (CLIP.person_a + NOISE[0]).astype(np.float32),
    (CLIP.person_b + OFFSET + NOISE[1]).astype(np.float32),
)


def capture(form: str, folder: Path) -> list[object]:
    """Write the pair in a format; return the words that name it."""
    if form == "bvh":
        for person, motion in (("A", PAIR.person_a), ("B", PAIR.person_b)):
            (folder / f"x_{person}.bvh").write_text(format_bvh(motion, 15, SBU15))
        return [folder / "x_A.bvh", folder / "x_B.bvh", "--from-unit", 1, "--from-up", "y"]
    if form == "clips":
        with write_motions(folder / "clips.parquet", SBU15) as writer:
            writer.add("one", PAIR)
        return [folder / "clips.parquet", "--clip", "one"]
    table = JointTable(SBU15, PAIR.times, (PAIR.person_a, PAIR.person_b), "y", 1.0)
    (folder / f"x{form}").write_bytes(TABLE_WRITERS[form](table))
    return [folder / f"x{form}"]


def run(*words: object) -> str:
    said = CliRunner().invoke(app, [*map(str, words)])
    assert said.exit_code == 0, said.output
    return " ".join(said.output.split())


def read(folder: Path, skeleton: Skeleton) -> tuple[Motion, Motion]:
    files = tuple(sorted(folder.glob("*.bvh")))
    reader = BvhPairs(**{**DEFAULT_SETTINGS["bvh"], "unit": 1, "up": "y"})
    found = reader.read(RawSequence("x", files)).interaction
    order = [found.skeleton.joints.index(joint) for joint in skeleton.joints]
    return found.person_a[:, order], found.person_b[:, order]


def distances(pair: tuple[Motion, Motion]) -> np.ndarray:
    return np.linalg.norm(pair[0][:, :, None] - pair[1][:, None], axis=-1)


def check(
    said: str, wanted: tuple[Motion, Motion], found: tuple[Motion, Motion], *, share: bool = True
) -> None:
    errors = [np.linalg.norm(f - w, axis=-1) for f, w in zip(found, wanted, strict=True)]
    joints = re.search(r"off by ([\d.]+) mm on average, ([\d.]+) mm at most", said)
    assert joints, said
    fitted = [error for error in errors if error.max() > 1e-4]  # a partner may be exact
    assert float(joints[1]) == pytest.approx(1e3 * np.mean(fitted), abs=0.06)
    assert float(joints[2]) == pytest.approx(1e3 * np.max(errors), abs=0.06)
    place = re.search(r"mm at most \((\w+) in frame (\d+) \(([\d.]+) s\) of (.*?)\)[ ;,]", said)
    assert place, said
    number = int("_B.bvh" in place[4] or place[4] == "person b")
    frame, joint = int(place[2]), SBU15.joints.index(place[1])
    assert 1e3 * errors[number][frame, joint] == pytest.approx(float(joints[2]), abs=0.06)
    assert float(place[3]) == pytest.approx(CLIP.times[frame] - CLIP.times[0], abs=0.01)
    printed = re.search(r"; ([\d.]+) % of the exact motion's ([\d,]+) touches", said)
    touch = distances(wanted) < CONTACT
    assert (touch.any() and share) == (printed is not None)
    if printed:
        held = (distances(found) < CONTACT)[touch].mean()
        assert float(printed[1]) == pytest.approx(100 * held, abs=0.06)
        assert int(printed[2].replace(",", "")) == touch.sum()
        missed = np.where(touch, distances(found), 0)
        named = re.search(
            r"are kept, the farthest missed (\w+) of person a and (\w+) of b in frame (\d+) "
            r"\(.*?\): ([\d.]+) cm",
            said,
        )
        assert (missed.max() >= CONTACT) == (named is not None)
        if named:
            a, b = SBU15.joints.index(named[1]), SBU15.joints.index(named[2])
            assert missed[int(named[3]), a, b] == pytest.approx(missed.max())
            assert 100 * missed.max() == pytest.approx(float(named[4]), abs=0.06)


@pytest.mark.parametrize("form", ["bvh", "clips", ".npz", ".csv", ".parquet"])
def test_augment_prints_what_is_in_the_files(form: str, tmp_path: Path) -> None:
    words = ["augment", *capture(form, tmp_path), "--b-scale", "left_forearm=1.3", "--params",
             PARAMS]  # fmt: skip
    run(*words, "--out", tmp_path / "exact.parquet")
    ((_, exact),) = stream_motions(tmp_path / "exact.parquet")
    said = run(*words, "--out", tmp_path / "files")
    found = read(tmp_path / "files", exact.skeleton)
    check(said, (exact.person_a, exact.person_b), found, share=False)
    assert said.count("contacts kept") == 1, "one share, under the name that the docs define"
    printed = re.search(r"contacts kept ([\d.]+) %", said)
    assert printed
    source = (PAIR.person_a, PAIR.person_b)
    source = read(tmp_path, exact.skeleton) if form == "bvh" else source
    kept, of_exact = (
        (distances(pair) < CONTACT)[distances(source) < CONTACT].mean()
        for pair in (found, (exact.person_a, exact.person_b))
    )
    assert form == "bvh" or abs(kept - of_exact) > 0.005
    # The command compares after the scene has the size of the source: about one forearm's part.
    assert float(printed[1]) == pytest.approx(100 * kept, abs=0.3)


@pytest.mark.parametrize("form", ["bvh", "clips", ".npz"])
def test_vary_prints_what_is_in_the_files(
    form: str,
    prior_weights: Path,
    tmp_path: Path,
) -> None:
    words = ["vary", *capture(form, tmp_path), "--weights", prior_weights, "--b-scale",
             "uniform=0.8"]  # fmt: skip
    run(*words, "--out", tmp_path / "exact.parquet")
    ((_, exact),) = stream_motions(tmp_path / "exact.parquet")
    said = run(*words, "--out", tmp_path / "files")
    check(said, (exact.person_a, exact.person_b), read(tmp_path / "files", exact.skeleton))


@pytest.mark.parametrize("form", ["clips", ".npz"])
def test_react_prints_what_is_in_the_files(
    form: str,
    reaction_weights: Path,
    tmp_path: Path,
) -> None:
    words = ["react", *capture(form, tmp_path), "--person", "a", "--weights", reaction_weights]
    run(*words, "--out", tmp_path / "exact.parquet")
    ((_, exact),) = stream_motions(tmp_path / "exact.parquet")
    said = run(*words, "--out", tmp_path / "files")
    check(said, (exact.person_a, exact.person_b), read(tmp_path / "files", exact.skeleton))


def test_export_prints_what_is_in_the_files_as_react_does(
    reaction_weights: Path, tmp_path: Path
) -> None:
    words = ["react", *capture("clips", tmp_path), "--person", "a", "--weights", reaction_weights]
    run(*words, "--out", tmp_path / "exact.parquet")
    ((name, exact),) = stream_motions(tmp_path / "exact.parquet")
    (tmp_path / "files").mkdir()
    word = f"{tmp_path / 'exact.parquet'}:{name}"
    said = run("export", word, "--out", tmp_path / "files" / "x.bvh")
    found = read(tmp_path / "files", exact.skeleton)
    check(said, (exact.person_a, exact.person_b), found)
    # The same bones are posed by the same rule: files of both are as far from the motion.
    of_react = run(*words, "--out", tmp_path / "again")
    figures = [[float(x) for x in re.findall(r"([\d.]+) mm", text)] for text in (said, of_react)]
    assert figures[0] == pytest.approx(figures[1], abs=0.5)
    # One person, and bones that are constant already.
    alone = run("export", tmp_path / "files" / "x_A.bvh", "--out", tmp_path / "alone.bvh",
                "--from-unit", 1, "--from-up", "y")  # fmt: skip
    assert "off by" not in alone


def test_of_a_capture_without_contacts_none_are_said_to_be_kept() -> None:
    sample = dict.fromkeys(MEASURES, 0.0) | {"contacts_kept": 1.0}
    touching, apart = (list(Measured((sample,), {}, has).lines(LIMITS)) for has in (True, False))
    assert [line for line in touching if line.startswith("  contacts kept")]
    assert not [line for line in apart if line.startswith("  contacts kept")]
    assert "  no contacts to keep: no compared joints are within 10 cm in the capture" in apart
