"""Truth: the lengths that were asked for, and files that our own readers read back."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner, Result

from pacmo_core.augmentation.bodies import measure_body, profile_scales
from pacmo_core.commands.cli import app
from pacmo_core.commands.places import FRAME_MEASURES
from pacmo_core.data.interaction import Interaction, bone_lengths
from pacmo_core.data.skeleton import SBU15, Skeleton
from pacmo_core.figures.variations import PRINTED
from pacmo_core.formats.write_tables import TABLE_WRITERS, JointTable
from pacmo_core.models import build_skeleton_prior, load_skeleton_prior
from pacmo_core.skeleton_prior.inference import retarget
from pacmo_core.skeleton_prior.kinematics import find_limbs
from pacmo_core.skeleton_prior.layers import initialise_weights
from pacmo_core.skeleton_prior.settings import PriorConfig
from pacmo_core.skeleton_prior.training import build_start
from pacmo_core.store.files import file_hash
from pacmo_core.store.motions import stream_motions, write_motions
from pacmo_core.store.weights import read_weights, write_weights
from pacmo_core.training.state import model_config, model_state
from tests.commands.test_augment import CLIP, FOREARM, UNIT, files, played, read, refused, stored
from tests.commands.test_augment import pacmo as augment
from tests.figures.samples import unpack_motion
from tests.skeleton_prior.examples import START

__all__ = ["files", "stored"]  # fixtures


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a model with fresh weights."""
    limbs = find_limbs(SBU15, CLIP.person_a)
    model = build_skeleton_prior(PriorConfig(SBU15, limbs, "kinematic", 16, 3, CLIP.fps, START))
    initialise_weights(model, torch.Generator().manual_seed(0))
    for weight in model.parameters():  # where the network begins at nothing too
        if not weight.any():
            torch.nn.init.constant_(weight, 0.01)
    path = tmp_path_factory.mktemp("model") / "weights.safetensors"
    config = {"model": "kinematic", "config": model_config(model)}
    write_weights(path, config, model_state(model))
    return path


def pacmo(*words: object) -> Result:
    return CliRunner().invoke(app, ["vary", *map(str, words)])


def test_a_body_that_is_asked_for_has_its_bones(stored: Path, weights: Path, tmp_path: Path):
    out = tmp_path / "out.parquet"
    said = pacmo(
        *(stored, "--clip", "one", "--weights", weights, "--b-scale", "left_forearm=1.2"),
        *("--samples", 3, "--out", out),
    )
    assert said.exit_code == 0, said.output
    found = dict(stream_motions(out))
    assert f"in {out} as {', '.join(found)}; " in said.output
    assert len(found) == 3
    wanted = bone_lengths(CLIP.person_b, SBU15)
    wanted[:, FOREARM] *= 1.2
    for pair in found.values():
        np.testing.assert_allclose(bone_lengths(pair.person_b, SBU15), wanted, atol=1e-5)
        np.testing.assert_allclose(
            bone_lengths(pair.person_a, SBU15), bone_lengths(CLIP.person_a, SBU15), atol=1e-5
        )
    first, second, _ = found.values()
    assert abs(first.person_b - second.person_b).max() > 0


def test_a_profile_is_that_of_augment_and_what_became_of_the_motion_is_said(
    stored: Path, weights: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.parquet"
    said = pacmo(
        *(stored, "--clip", "one", "--weights", weights, "--profile", "b=child", "--out", out)
    )
    assert said.exit_code == 0, said.output
    of_augment = augment(stored, "--clip", "one", "--profile", "b=child", "--out", tmp_path / "a")
    ours, theirs = (
        [
            line[2:20].strip()
            for line in text.splitlines()
            # Of some motions only: a turn of the capture, and what is beyond a limit.
            if re.match(r"  (\S.{,17}  |no contacts|person)", line) and "wors" not in line
        ]
        for text in (said.output, of_augment.output)
    )
    wanted = [*PRINTED, *FRAME_MEASURES, "person a", "person b"]
    assert ours == theirs and len(ours) == len(wanted)
    assert "of what looks natural (augment.limits of params.yaml, and those above)" in said.output
    ((_, pair),) = stream_motions(out)
    before = bone_lengths(CLIP.person_b, SBU15)
    scales = profile_scales(measure_body(CLIP.person_b, SBU15), "child")
    np.testing.assert_allclose(bone_lengths(pair.person_b, SBU15), scales * before, atol=1e-5)


def test_drawn_bodies_differ_and_come_as_a_folder_each(
    files: list[Path], weights: Path, tmp_path: Path
):
    folders = [tmp_path / "one", tmp_path / "two"]
    for out in folders:
        said = pacmo(*files, *UNIT, "--weights", weights, "--samples", 2, "--out", out)
        assert said.exit_code == 0, said.output
    bodies = [bone_lengths(read(folders[0] / n).person_b, SBU15).mean(axis=0) for n in "01"]
    assert abs(bodies[0] / bodies[1] - 1).max() > 1e-3
    texts = [(out / "1" / "duo_B.bvh").read_bytes() for out in folders]
    assert texts[0] == texts[1], "the same seed draws the same"


def evaluate(folder: Path, weights: Path, **gains: dict[str, float]) -> Path:
    """Write weights and their evaluation into a project; return the weights there."""
    there = folder / "models" / "weights.safetensors"
    there.parent.mkdir(exist_ok=True)
    there.write_bytes(weights.read_bytes())
    hashes = [file_hash(there)]
    gain = {"motions": 4, "seeds": 1, "confidence": 0.95, "weights": hashes, **gains}
    (folder / "reports").mkdir(exist_ok=True)
    (folder / "reports" / "skeleton_prior.json").write_text(
        json.dumps({"gain": {"default": {"random": gain}}})
    )
    return there


CLEAR = {"start": 0.02, "trained": 0.01, "mean": 0.5, "low": 0.1, "high": 0.9}


@pytest.mark.parametrize(
    ("jpd", "words", "wanted"),
    [
        (CLEAR, (), "the network is used, shown to be better than its start (tested on default"),
        (
            {**CLEAR, "low": -0.1},
            (),
            "the start alone, a rule without training, is used: the network is not shown",
        ),
        (
            {**CLEAR, "mean": 0.15},
            (),
            "the start alone, a rule without training, is used: the network is not shown",
        ),
        (
            {"start": 0.02, "trained": 0.01, "mean": 0.5},
            (),
            "the start alone, a rule without training, is used: the network is not shown",
        ),
        (CLEAR, ("--no-network",), "the start alone, a rule without training, is used, as asked"),
        ({**CLEAR, "low": -0.1}, ("--network",), "the network is used, as asked"),
    ],
)
def test_the_network_is_used_where_its_evaluation_shows_that_it_is_better(
    stored: Path, weights: Path, tmp_path: Path, jpd: dict[str, float], words: tuple, wanted: str
) -> None:
    there = evaluate(tmp_path, weights, E_r=CLEAR, JPD=jpd)
    out = tmp_path / "out.parquet"
    body = ("--b-scale", "left_forearm=1.2")
    said = pacmo(stored, "--clip", "one", "--weights", there, *body, *words, "--out", out)
    assert said.exit_code == 0, said.output
    assert wanted in said.output
    figures = "4 motions; start to network, 95 % intervals: error of joints E_r 20.0 to 10.0 mm"
    assert f"(tested on default/random, {figures}" in said.output
    ((_, pair),) = stream_motions(out)
    start = build_start(load_skeleton_prior(weights).config)
    scales = np.ones((1, 2, len(SBU15.bones)))
    scales[0, 1, FOREARM] = 1.2
    ((of_start,),) = retarget(start, CLIP, scales, samples=1, random=None, finish=True)
    is_start = np.allclose(pair.person_b, of_start.person_b, atol=1e-6)
    assert is_start == ("the start alone" in wanted)


@pytest.mark.parametrize(
    ("sampled", "wanted"),
    [
        (CLEAR, "the network is used, shown to be better than its start (tested on default/random"),
        ({**CLEAR, "low": -0.1}, "rule without training, is used: the network is not shown to be"),
        (None, "is not shown to be better (tested on default/random, 4 motions, not on sampled"),
    ],
)
def test_of_sampled_bodies_the_evaluation_on_sampled_bodies_decides(
    stored: Path, weights: Path, tmp_path: Path, sampled: dict[str, float] | None, wanted: str
) -> None:
    gains = {"E_r": CLEAR, "JPD": CLEAR} | ({"JPD_sampled": sampled} if sampled else {})
    there = evaluate(tmp_path, weights, **gains)
    out = tmp_path / "out.parquet"
    said = pacmo(stored, "--clip", "one", "--weights", there, "--out", out)
    assert said.exit_code == 0 and wanted in said.output
    body = ("--b-scale", "left_forearm=1.2")
    said = pacmo(stored, "--clip", "one", "--weights", there, *body, "--out", out)
    assert "the network is used, shown to be better" in said.output


def test_without_evidence_of_these_weights_the_network_is_used(
    stored: Path, weights: Path, tmp_path: Path
) -> None:
    given = [stored, "--clip", "one", "--out", tmp_path / "out.parquet", "--weights"]
    without = "the network is used (no reports/skeleton_prior.json compares these weights"
    assert without in pacmo(*given, weights).output
    there = evaluate(tmp_path, weights, E_r=CLEAR, JPD={**CLEAR, "low": -0.1})
    config, state = read_weights(there)
    write_weights(there, {**config, "settings": "of a later training"}, state)
    assert without in pacmo(*given, there).output
    report = tmp_path / "reports" / "skeleton_prior.json"
    report.write_text("{}")
    refused(pacmo(*given, there), f"{report}: not an evaluation of skeleton priors: 'gain'")


def test_the_start_moves_sampled_bodies_and_makes_one_motion_of_each(
    stored: Path, weights: Path, tmp_path: Path
) -> None:
    given = [stored, "--clip", "one", "--weights", weights, "--samples", 2, "--out"]
    made = {}
    for name, words in {"network": (), "start": ("--no-network",)}.items():
        said = pacmo(*given, tmp_path / f"{name}.parquet", *words)
        assert said.exit_code == 0 and "are equal" not in said.output
        made[name] = [pair for _, pair in stream_motions(tmp_path / f"{name}.parquet")]
    lengths = {
        name: [bone_lengths(pair.person_b, SBU15).mean(axis=0) for pair in pairs]
        for name, pairs in made.items()
    }
    np.testing.assert_allclose(lengths["start"], lengths["network"], rtol=1e-4)
    own = bone_lengths(CLIP.person_b, SBU15).mean(axis=0).sum()
    means = ", ".join(f"{one.sum() / own:.2f}" for one in lengths["start"])
    line = "sampled bodies, mean length of the bones: person a as captured; person b "
    ratios = np.array(lengths["start"]) / bone_lengths(CLIP.person_b, SBU15).mean(axis=0)
    bones = f"single bones {ratios.min():.2f} to {ratios.max():.2f}"
    assert f"{line}{means} of the captured, {bones}" in said.output
    body = ("--profile", "b=child", "--no-network")
    said = pacmo(*given, tmp_path / "one.parquet", *body)
    assert "the start makes one motion of a body: the 2 samples are equal" in said.output
    assert "sampled bodies" not in said.output
    first, second = (pair for _, pair in stream_motions(tmp_path / "one.parquet"))
    np.testing.assert_array_equal(first.person_b, second.person_b)


def test_a_page_plays_the_source_beside_the_samples(
    files: list[Path], weights: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    said = pacmo(*files, *UNIT, "--weights", weights, "--samples", 7, "--out", out)
    page = out / "duo_A.html"
    assert f"beside the source in {page}" in said.output
    scenes = played(page)
    assert [scene["label"] for scene in scenes] == [
        "source",
        *(f"variation {number}" for number in range(5)),
    ]
    shown = unpack_motion(scenes[2]["motions"][1], np.array(scenes[2]["origin"]), scenes[2]["step"])
    found = read(out / "1")
    written = found.person_b[:, found.skeleton.indices(SBU15.joints)]
    np.testing.assert_allclose(shown, written.reshape(-1, 3), atol=1e-3)


def test_samples_do_not_write_over_the_capture_that_they_come_from(
    files: list[Path], weights: Path, tmp_path: Path
):
    folder = tmp_path / "1"
    folder.mkdir()
    captures = [folder / file.name for file in files]
    for file, capture in zip(files, captures, strict=True):
        capture.write_bytes(file.read_bytes())
    said = pacmo(*captures, *UNIT, "--weights", weights, "--samples", 2, "--out", tmp_path)
    refused(said, "would overwrite")
    assert [file.read_bytes() for file in files] == [file.read_bytes() for file in captures]
    assert not (tmp_path / "0").exists()


def test_what_cannot_be_varied_is_one_line(
    stored: Path, files: list[Path], weights: Path, tmp_path: Path
):
    given = [stored, "--clip", "one", "--weights", weights]
    refused(pacmo(*given[:3], "--weights", stored, "--out", tmp_path), str(stored))
    config, state = read_weights(weights)
    del config["config"]["fps"]
    write_weights(tmp_path / "old.safetensors", config, state)
    old = ["--weights", tmp_path / "old.safetensors"]
    refused(pacmo(*given[:3], *old, "--out", tmp_path), "another version")
    refused(pacmo(*given, "--out", stored), "would overwrite")
    refused(pacmo(*given, "--samples", 2, "--out", tmp_path / "x.bvh"), "2 samples")
    refused(pacmo(*given, "--b-scale", "tail=2", "--out", tmp_path), "tail")


def test_a_table_is_varied_like_a_clip_of_the_store(
    stored: Path, weights: Path, tmp_path: Path
) -> None:
    table = JointTable(SBU15, CLIP.times, (CLIP.person_a, CLIP.person_b), "y", 1.0)
    (tmp_path / "one.npz").write_bytes(TABLE_WRITERS[".npz"](table))
    words = ["--weights", weights, "--b-scale", "left_forearm=1.2", "--out"]
    assert pacmo(tmp_path / "one.npz", *words, tmp_path / "table.parquet").exit_code == 0
    assert pacmo(stored, "--clip", "one", *words, tmp_path / "clip.parquet").exit_code == 0
    ((_, made),) = stream_motions(tmp_path / "table.parquet")
    ((_, wanted),) = stream_motions(tmp_path / "clip.parquet")
    np.testing.assert_allclose(made.person_b, wanted.person_b, atol=1e-5)


def test_weights_that_are_not_there_are_said_to_come_from_training(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    absent = Path("models") / "priors"
    said = pacmo(stored, "--clip", "one", "--out", tmp_path / "o.parquet", "--weights", absent)
    refused(said, "no models/priors: ./run trains those in models/; --weights")


def test_the_names_of_joints_are_checked_before_the_weights(stored: Path, tmp_path: Path) -> None:
    words = ["--clip", "one", "--out", tmp_path / "o.parquet", "--weights", tmp_path / "none"]
    said = pacmo(stored, *words, "--joints", "a=mixmo")
    refused(said, "no preset of joints 'mixmo'; wanted mixamo, ")


def test_joints_that_coincide_are_refused_with_what_helps(weights: Path, tmp_path: Path) -> None:
    neck, head = SBU15.indices(["neck", "head"])
    moved = CLIP.person_b.copy()
    moved[3, head] = moved[3, neck]
    with write_motions(tmp_path / "motions.parquet", SBU15) as writer:
        writer.add("one", replace(CLIP, person_b=moved))
    said = pacmo(tmp_path / "motions.parquet", "--clip", "one", "--weights", weights,
                 "--out", tmp_path / "o.parquet")  # fmt: skip
    assert said.exit_code == 1
    wanted = "neck and head coincide in frame 3: wanted another joint of the capture for one of"
    assert wanted in said.stderr and "--joints head=JOINT" in said.stderr


def test_a_joint_that_is_always_where_its_parent_is_has_its_name(
    weights: Path, tmp_path: Path
) -> None:
    neck, head = SBU15.indices(["neck", "head"])
    moved = CLIP.person_b.copy()
    moved[:, head] = moved[:, neck]
    with write_motions(tmp_path / "motions.parquet", SBU15) as writer:
        writer.add("one", replace(CLIP, person_b=moved))
    said = pacmo(tmp_path / "motions.parquet", "--clip", "one", "--weights", weights,
                 "--out", tmp_path / "o.parquet")  # fmt: skip
    refused(said, "neck and head coincide in frame 0: wanted another joint")


def test_joints_that_coincide_are_refused_with_the_joints_that_are_free(
    weights: Path, tmp_path: Path
) -> None:
    """Truth: a capture of more joints than SBU's, of which one is of the trunk."""
    neck, torso = SBU15.indices(["neck", "torso"])
    body = Skeleton("more", (*SBU15.joints, "chest", "left_rib", "right_rib"),
                    (*SBU15.parents, torso, torso, torso),
                    (*SBU15.left_right, (16, 17)))  # fmt: skip
    people = []
    for motion in (CLIP.person_a, CLIP.person_b):
        chest = (motion[:, [neck]] + motion[:, [torso]]) / 2
        ribs = [motion[:, [neck]] + np.float32([x, 0, 0]) for x in (0.02, -0.02)]
        people.append(np.concatenate([motion, chest, *ribs], axis=1))
    people[0][3, SBU15.joints.index("head")] = people[0][3, neck]
    with write_motions(tmp_path / "motions.parquet", body) as writer:
        writer.add("one", Interaction(body, CLIP.times, *people))
    said = pacmo(tmp_path / "motions.parquet", "--clip", "one", "--weights", weights,
                 "--out", tmp_path / "o.parquet")  # fmt: skip
    text = "such as --joints neck=chest (the nearest that no joint of the model is: chest)"
    refused(said, "neck and head coincide in frame 3", text)


def test_several_profiles_in_a_call_are_refused_in_a_line(
    stored: Path, weights: Path, tmp_path: Path
) -> None:
    said = pacmo(stored, "--clip", "one", "--weights", weights, "--out", tmp_path / "o.parquet",
                 "--profile", "b=child,tall_adult")  # fmt: skip
    assert said.exit_code == 1
    assert "vary takes one profile a person in a call; got b=child,tall_adult" in said.output
