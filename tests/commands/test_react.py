"""Truth: the Python call with the same seed; files that our own readers read back."""

import io
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from typer.testing import CliRunner, Result

from pacmo_core.api import synthesise
from pacmo_core.commands import captures
from pacmo_core.commands.cli import app
from pacmo_core.data.interaction import Interaction, bone_lengths
from pacmo_core.data.segments import feet
from pacmo_core.data.skeleton import SBU15, Skeleton
from pacmo_core.finish.stance import find_stance
from pacmo_core.formats.bvh import read_bvh
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.resample import from_y_up, sample_times
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.formats.write_tables import TABLE_WRITERS, JointTable
from pacmo_core.models import load_reaction_model
from pacmo_core.reaction import wgan
from pacmo_core.reaction.baselines import build_regression_training
from pacmo_core.reaction.inference import PACKAGED, finish_reactions, react
from pacmo_core.reaction.windows import PartnerMotion
from pacmo_core.store.motions import stream_motions, write_motions
from pacmo_core.store.weights import write_weights
from pacmo_core.training.state import model_config, model_state
from tests.formats.real_files import real_folder
from tests.reaction.problems import PACMO_LONG, REGRESSION, clips, delayed_mirror

CLIP = delayed_mirror(1, np.arange(40) / 15)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    model = wgan.build_training(clips(8), replace(PACMO_LONG, n_epochs=2)).finish()
    path = tmp_path_factory.mktemp("model") / "weights.safetensors"
    write_weights(path, {"model": "pacmo", "config": model_config(model)}, model_state(model))
    return path


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    with write_motions(tmp_path / "motions.parquet", SBU15) as writer:
        writer.add("one", CLIP)
    return tmp_path / "motions.parquet"


def pacmo(*words: object) -> Result:
    return CliRunner().invoke(app, ["react", *map(str, words)])


def refused(said: Result, *texts: str) -> None:
    assert said.exit_code == 1, said.output
    assert said.stderr.count("\n") == 1
    for text in texts:
        assert text in said.stderr


@pytest.mark.parametrize("finish", [True, False])
def test_parquet_holds_an_interaction_a_sample_as_the_python_call_gives_it(
    weights: Path, stored: Path, tmp_path: Path, finish: bool
) -> None:
    out = tmp_path / "out.parquet"
    words = ["--clip", "one", "--person", "b", "--weights", weights, "--to-fps", 60, "--samples", 3]
    option = "--finish" if finish else "--no-finish"
    said = pacmo(stored, *words, option, "--seed", 5, "--out", out)
    assert f"in {out} as one#0000 ... one#0002: " in said.output
    found = dict(stream_motions(out))
    assert list(found) == ["one#0000", "one#0001", "one#0002"]

    model = load_reaction_model(weights)
    at = sample_times(CLIP.times, fps=60)
    random = torch.Generator().manual_seed(5)
    samples = react(model, CLIP.person_b, CLIP.times, out_times=at, n_samples=3, random=random)
    partner = PartnerMotion(CLIP.person_b, CLIP.times, at)
    if finish:
        samples = finish_reactions(model, partner, samples)
    for pair, sample in zip(found.values(), samples, strict=True):
        np.testing.assert_allclose(pair.person_b, sample, atol=1e-5)
        np.testing.assert_allclose(pair.person_a[::4], CLIP.person_b, atol=1e-5)
        np.testing.assert_allclose(pair.times, at)


def test_bvh_holds_a_file_a_person_a_sample_and_goes_in_again(
    weights: Path, stored: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out" / "dance.bvh"
    words = ["--clip", "one", "--person", "a", "--weights", weights, "--samples", 2, "--out", out]
    assert pacmo(stored, *words).exit_code == 0
    names = ["dance_0_A.bvh", "dance_0_B.bvh", "dance_1_A.bvh", "dance_1_B.bvh"]
    assert sorted(file.name for file in out.parent.iterdir()) == names
    pairs = BvhPairs(
        preset="pair", unit=1, up="y", fps=None, end_sites=False, skip_frames=0,
        max_root_distance=None,
    )  # fmt: skip
    first, second = (pairs.read(s).interaction for s in pairs.find(out.parent))
    root = first.skeleton.root
    assert np.array_equal(first.person_a, second.person_a)
    np.testing.assert_allclose(first.person_a[:, root], CLIP.person_a[:, SBU15.root], atol=1e-2)
    again = [
        names[0],
        "--from-unit",
        1,
        "--from-up",
        "y",
        "--weights",
        weights,
        "--out",
        tmp_path / "2.bvh",
    ]
    assert pacmo(out.parent / again[0], *again[1:]).exit_code == 0


def test_in_bvh_files_feet_stand_and_contacts_are_closed_as_in_the_points(
    tmp_path: Path,
) -> None:
    name, clip = next((n, c) for n, c in synthesise(4).items() if n.startswith("handshake"))
    with write_motions(tmp_path / "motions.parquet", clip.skeleton) as writer:
        writer.add(name, clip)
    words = ["--clip", name, "--person", "a", "--weights", PACKAGED, "--seed", 3, "--samples", 2]
    for file in ("x.parquet", "x.bvh"):
        said = pacmo(tmp_path / "motions.parquet", *words, "--out", tmp_path / file)
        assert said.exit_code == 0, said.output
    touches = r"([\d.]+) % of the exact motion's [\d,]+ touches"
    kept = re.search(rf"slide ([\d.]+) cm/s (\w+); {touches}", said.stdout)
    assert kept is not None, said.stdout
    assert kept[2] == "less" or float(kept[1]) < 0.05
    assert float(kept[3]) >= 95  # the partner's bones, which are noisy, are not constant
    for number, made in enumerate(dict(stream_motions(tmp_path / "x.parquet")).values()):
        files = [read_bvh(tmp_path / f"x_{number}_{person}.bvh") for person in "AB"]
        joints = made.skeleton.joints
        held = [bvh.positions()[:, [bvh.joints.index(name) for name in joints]] for bvh in files]
        stance = find_stance(made.person_b, made.fps, made.skeleton)
        for foot, stands in zip(feet(made.skeleton), stance, strict=True):
            off = held[1][stands][:, list(foot)] - made.person_b[stands][:, list(foot)]
            assert np.linalg.norm(off, axis=-1).max() < 5e-3
        near, near_in_file = (
            np.linalg.norm(b[:, :, None] - a[:, None], axis=-1) < 0.1
            for a, b in ((made.person_a, made.person_b), held)
        )
        assert near.sum() > 20
        # Of one sample alone: some joints are at the limit, 10 cm, where millimetres count.
        assert (near & near_in_file).sum() >= 0.9 * near.sum()


def test_files_of_one_person_need_no_name_and_those_of_two_do(
    weights: Path, tmp_path: Path
) -> None:
    bvh, out = tmp_path / "alone.bvh", tmp_path / "out.parquet"
    bvh.write_text(format_bvh(CLIP.person_a, 15, SBU15))
    words = ["--weights", weights, "--out", out]
    assert pacmo(bvh, "--from-unit", 1, "--from-up", "y", *words).exit_code == 0
    inferred = pacmo(bvh, *words)
    assert inferred.exit_code == 0, inferred.output
    assert f"inferred for {bvh} (1." in inferred.stdout
    assert "metres, y up" in inferred.stdout
    renamed = tmp_path / "renamed.bvh"
    renamed.write_text(bvh.read_text().replace("left_knee", "xyz"))
    said = "not recognised among its joints: left shin, right shin; and it states no unit"
    refused(pacmo(renamed, *words), said, "--joints")
    sbu = tmp_path / "skeleton_pos.txt"
    sbu.write_text("".join(f"{i + 1}," + ",".join(["0.5"] * 90) + "\n" for i in range(9)))
    refused(pacmo(sbu, *words), "suffix", "--format", "files of this name are those of sbu and")
    refused(pacmo(sbu, "--format", "sbu", *words), "two people", "--person")
    refused(pacmo(bvh, "--person", "b", *words), "one person", "leave out --person b")
    table = tmp_path / "alone.npz"
    alone = JointTable(SBU15, CLIP.times, [CLIP.person_a], "y", 1.0)
    table.write_bytes(TABLE_WRITERS[".npz"](alone))
    assert pacmo(table, *words).exit_code == 0
    refused(pacmo(table, "--person", "b", *words), "one person", "leave out --person b")


def test_one_of_two_who_stand_along_another_axis_is_refused(tmp_path: Path, weights: Path) -> None:
    table, words = tmp_path / "two.npz", ["--weights", weights, "--out", tmp_path / "o.parquet"]
    still = [np.repeat(motion[:1], 30, axis=0) for motion in (CLIP.person_a, CLIP.person_b)]
    for up, is_right in (("y", True), ("z", False)):
        people = [from_y_up(motion, up) for motion in still]
        table.write_bytes(
            TABLE_WRITERS[".npz"](JointTable(SBU15, np.arange(30) / 15, people, "y", 1))
        )
        for person in ("a", "b"):
            said = pacmo(table, "--person", person, *words)
            assert (said.exit_code == 0) == is_right, said.output
            assert ("lying while standing" in said.stderr) == (not is_right)


def test_weights_that_know_an_object_are_told_where_a_table_has_it(tmp_path: Path) -> None:
    joints, parents = (*SBU15.joints, "object"), (*SBU15.parents, SBU15.root)
    held = Skeleton("held", joints, parents, SBU15.left_right)

    def with_object(clip: Interaction) -> Interaction:
        place, root = clip.person_a[:, [4]] + np.float32(0.2), [SBU15.root]
        people = [np.concatenate([clip.person_a, place], axis=1),
                  np.concatenate([clip.person_b, clip.person_b[:, root]], axis=1)]  # fmt: skip
        return replace(clip, skeleton=held, person_a=people[0], person_b=people[1])

    captures = list(map(with_object, clips(4)))
    trained = wgan.build_training(captures, replace(PACMO_LONG, n_epochs=2)).finish()
    weights = tmp_path / "weights.safetensors"
    facts = {"model": "pacmo", "config": model_config(trained)}
    write_weights(weights, facts, model_state(trained))
    table = {"joints": SBU15.joints, "parents": SBU15.parents, "fps": 15, "unit": 1.0, "up": "y"}
    out, files = tmp_path / "out.parquet", [tmp_path / "told.npz", tmp_path / "untold.npz"]
    place = with_object(CLIP).person_a[:, -1]
    np.savez(files[0], person_a=CLIP.person_a, object=place, **table)
    np.savez(files[1], person_a=CLIP.person_a, **table)
    said = pacmo(files[0], "--weights", weights, "--out", out)
    assert said.exit_code == 0, said.output
    ((_, reaction),) = stream_motions(out)
    np.testing.assert_allclose(reaction.person_a[:, -1], place, atol=1e-5)
    refused(pacmo(files[1], "--weights", weights, "--out", out), "no object: wanted (T, 3)")


def test_at_twice_a_rounded_rate_the_last_frame_stays(weights: Path, tmp_path: Path) -> None:
    bvh, out = tmp_path / "alone.bvh", tmp_path / "out.parquet"
    motion = np.tile(CLIP.person_a, (1 + 700 // len(CLIP.times), 1, 1))
    text = format_bvh(motion, 30, SBU15)
    assert "Frame Time: 0.033333333" in text
    bvh.write_text(text.replace("Frame Time: 0.033333333", "Frame Time: 0.033333"))
    words = ["--from-unit", 1, "--from-up", "y", "--to-fps", 60, "--weights", weights]
    said = pacmo(bvh, *words, "--out", out)
    assert said.exit_code == 0, said.output
    ((_, reaction),) = stream_motions(out)
    assert len(reaction.times) == 2 * len(motion) - 1


@pytest.mark.parametrize("ending", TABLE_WRITERS)
def test_a_table_is_a_partner_like_any_capture(
    weights: Path, stored: Path, tmp_path: Path, ending: str
) -> None:
    people = (CLIP.person_a, CLIP.person_b)
    words = ["--weights", weights, "--seed", 3, "--out"]
    for name, in_table in (("pair", people), ("alone", people[1:])):
        table = JointTable(SBU15, CLIP.times, in_table, "y", 1.0)
        (tmp_path / f"{name}{ending}").write_bytes(TABLE_WRITERS[ending](table))
    pair, alone = (tmp_path / f"{name}{ending}" for name in ("pair", "alone"))
    refused(pacmo(pair, *words, tmp_path / "x.parquet"), "two people")
    assert pacmo(pair, "--person", "b", *words, tmp_path / "pair.out.parquet").exit_code == 0
    assert pacmo(alone, *words, tmp_path / "alone.out.parquet").exit_code == 0
    wanted = tmp_path / "wanted.parquet"
    assert pacmo(stored, "--clip", "one", "--person", "b", *words, wanted).exit_code == 0
    ((_, wanted_pair),) = stream_motions(wanted)
    for name in ("pair", "alone"):
        ((_, made),) = stream_motions(tmp_path / f"{name}.out.parquet")
        np.testing.assert_allclose(made.person_b, wanted_pair.person_b, atol=5e-4)


def test_what_cannot_be_done_is_one_line(weights: Path, stored: Path, tmp_path: Path) -> None:
    out, clip = tmp_path / "out.parquet", ["--clip", "one", "--person", "a"]
    there = ["--weights", weights, "--out", out]
    refused(pacmo(stored, *there), "--clip")
    refused(pacmo(stored, "--clip", "two", "--person", "a", *there), "no clip two")
    refused(pacmo(stored, *clip, "--weights", weights), "--out")
    refused(pacmo(stored, *clip, "--weights", weights, "--out", tmp_path / "a.gif"), ".parquet")
    refused(pacmo(stored, *clip, "--weights", tmp_path / "none", "--out", out), "none")
    refused(pacmo(tmp_path / "no.bvh", "--from-unit", 1, "--from-up", "y", *there), "no.bvh")
    refused(pacmo(stored, *clip, *there, "--to-fps", -1), "--to-fps")
    refused(pacmo("--stream", "--weights", weights, "--to-unit", "cm"), "leave out --to-unit")
    refused(pacmo(stored, "--clip", "one", "--person", "B", *there), "--person: wanted a or b")
    handless = SBU15.without(["left_hand"])
    motion = CLIP.person_a[:, SBU15.indices(handless.joints)]
    (tmp_path / "x.bvh").write_text(format_bvh(motion, 15, handless))
    refused(
        pacmo(tmp_path / "x.bvh", *there), "x.bvh", "left_hand (nearest: left_elbow)", "--joints"
    )
    assert not out.exists()


def test_a_partner_is_not_overwritten(weights: Path, stored: Path, tmp_path: Path) -> None:
    before = stored.read_bytes()
    words = [stored, "--clip", "one", "--person", "a", "--weights", weights, "--out"]
    refused(pacmo(*words, stored), f"{stored}: this would overwrite {stored}")
    assert stored.read_bytes() == before
    captured = tmp_path / "p_0_A.bvh"
    captured.write_text(format_bvh(CLIP.person_a, 15, SBU15))
    text = captured.read_text()
    told = ["--from-unit", 1, "--from-up", "y", "--weights", weights, "--out", tmp_path / "p.bvh"]
    refused(pacmo(captured, *told), f"would overwrite {captured}")
    assert captured.read_text() == text


def test_real_captures_of_sbu_are_answered(weights: Path, tmp_path: Path) -> None:
    file = next(iter(sorted(real_folder("sbu").rglob("skeleton_pos.txt"))))
    words = ["--format", "sbu", "--person", "b", "--weights", weights, "--to-fps", 120]
    assert pacmo(file, *words, "--out", tmp_path / "out.parquet").exit_code == 0
    ((_, pair),) = stream_motions(tmp_path / "out.parquet")
    assert pair.fps == pytest.approx(120)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["json", "numbers"])
def test_a_live_partner_is_answered_frame_by_frame(weights: Path, form: str) -> None:
    command = [
        sys.executable,
        "-m",
        "pacmo_core.commands.cli",
        "react",
        "--stream",
        "--weights",
        str(weights),
    ]
    with subprocess.Popen(
        [*command, "--samples", "2"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as live:  # fmt: skip
        for pose, time in zip(CLIP.person_a[:6], CLIP.times[:6].tolist(), strict=True):
            line = json.dumps({"time": time, "pose": pose.tolist()})
            if form == "numbers":
                line = " ".join(map(str, [time, *pose.reshape(-1).tolist()]))
            live.stdin.write(f"{line}\n")
            live.stdin.flush()
            answer = live.stdout.readline()  # before the next frame is sent
            if form == "json":
                facts = json.loads(answer)
                assert facts["time"] == time
                assert np.isfinite(facts["reactions"]).all()
                assert np.shape(facts["reactions"]) == (2, 15, 3)
            else:
                assert len(answer.split()) == 1 + 2 * 45
        live.stdin.write("1 2 3\n")
        live.stdin.close()
        said = live.stderr.read()
        assert live.wait() == 1
    assert said.splitlines()[0].startswith("joints: head neck")
    assert "line 7: wanted a time and 45 numbers" in said


@pytest.mark.parametrize(("unit", "axes"), [(1, [0, 1, 2]), (100, [0, 1, 2]), (1, [0, 2, 1])])
def test_a_live_partner_is_in_metres_and_y_up(weights: Path, unit: int, axes: list[int]) -> None:
    pose = unit * CLIP.person_a[0][:, axes]
    frames = "".join(f"{json.dumps({'time': t, 'pose': pose.tolist()})}\n" for t in (0.0, 0.1))
    words = ["react", "--stream", "--weights", str(weights)]
    said = CliRunner().invoke(app, words, input=frames)
    assert said.exit_code == (unit != 1)
    assert len(said.stdout.splitlines()) == (0 if unit != 1 else 2)
    assert ("line 1: a person of" in said.stderr) == (unit != 1)
    assert "frames are in metres" in said.stderr or unit == 1
    assert ("the first frame: the trunk" in said.stderr) == (axes[1] != 1)


def test_weights_that_are_not_there_are_said_to_come_from_training(
    stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = (
        "--clip",
        "one",
        "--out",
        tmp_path / "o.parquet",
        "--weights",
        "models/weights.safetensors",
    )
    said = pacmo(stored, *words)
    refused(said, "no models/", "/weights.safetensors: ./run trains those in models/; --weights")


def test_the_names_of_joints_are_checked_before_the_weights(stored: Path, tmp_path: Path) -> None:
    words = ["--clip", "one", "--out", tmp_path / "o.parquet", "--weights", tmp_path / "none"]
    said = pacmo(stored, *words, "--joints", "a=mixmo")
    refused(said, "no preset of joints 'mixmo'; wanted mixamo, ")


def test_a_second_capture_is_refused_with_the_commands_that_take_two(
    weights: Path, tmp_path: Path
) -> None:
    words = ["--weights", weights, "--out", tmp_path / "o.bvh"]
    for files in (["A.bvh", "B.bvh"], ["A.bvh+B.bvh"]):
        said = pacmo(*files, *words)
        refused(said, "react takes one partner", "A.bvh and B.bvh", "pacmo augment or pacmo vary")
    assert "more" not in pacmo("--help").stdout.split("Options")[0].split("\n")[0]


def test_it_says_which_file_is_the_partner_and_which_the_reaction(
    weights: Path, stored: Path, tmp_path: Path
) -> None:
    words = [stored, "--clip", "one", "--person", "a", "--weights", weights, "--out"]
    said = pacmo(*words, tmp_path / "x.bvh").stdout
    assert f"the partner in {tmp_path}/x_0_A.bvh, the reaction in {tmp_path}/x_0_B.bvh" in said
    said = pacmo(*words, tmp_path / "x.parquet").stdout
    assert "person_a is the partner, person_b the reaction" in said


def test_another_format_is_refused_with_the_two_commands_that_write_it(
    weights: Path, stored: Path, tmp_path: Path
) -> None:
    words = [stored, "--clip", "one", "--person", "a", "--weights", weights, "--out"]
    refused(pacmo(*words, "x.glb"), "react ... --out x.parquet, then pacmo export x.parquet:NAME")
    wanted = "x.fbx: wanted a .parquet or .bvh file, or a folder for BVH files; pacmo export makes"
    refused(pacmo(*words, "x.fbx"), wanted)
    assert pacmo(*words, tmp_path / "x.parquet").exit_code == 0
    export = ["export", f"{tmp_path}/x.parquet:one#0000", "--out", str(tmp_path / "x.glb")]
    assert CliRunner().invoke(app, export).exit_code == 0


def test_a_folder_that_takes_no_file_is_named_before_anything_is_read(
    weights: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", Path("/proc")):
        said = pacmo(tmp_path / "none.bvh", "--weights", weights, "--out", folder / "x.bvh")
        refused(said, f"{folder / 'x.bvh'}: {folder} takes no file: ")


def test_the_folder_of_the_files_is_asked_and_not_the_one_above_it(
    weights: Path, stored: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Path] = []

    def make(**where: Path) -> io.BytesIO:
        asked.append(where["dir"])
        return io.BytesIO()

    monkeypatch.setattr(captures, "TemporaryFile", make)
    (tmp_path / "there").mkdir()
    words = [stored, "--clip", "one", "--person", "a", "--weights", weights, "--out"]
    for out, folder in (("there", "there"), ("there/x.bvh", "there"), ("new/x.bvh", ".")):
        asked.clear()
        assert pacmo(*words, tmp_path / out).exit_code == 0
        assert asked == [tmp_path / folder]


def test_a_capture_of_many_actions_is_said_to_be_long(weights: Path, tmp_path: Path) -> None:
    partner = tmp_path / "alone.bvh"
    words = [partner, "--weights", weights, "--out", tmp_path / "o.parquet"]
    texts = []
    for motion in (CLIP.person_a[:20], np.concatenate([CLIP.person_a] * 12)):
        partner.write_text(format_bvh(motion, 15, SBU15))
        said = pacmo(*words)
        assert said.exit_code == 0, said.output
        texts.append(said.stdout)
    assert "the capture lasts" not in texts[0]
    assert (
        f"the capture lasts {(12 * len(CLIP.times) - 1) / 15:.1f} s, an action of the" in texts[1]
    )


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights that know three actions."""
    labels = ["A1 wave", "A2 shake hands", "A3 hand over", "A2 shake hands"]
    settings = replace(PACMO_LONG, n_epochs=2, action_channels=2, action_dropout=0.5)
    model = wgan.build_training(clips(4), settings, actions=labels).finish()
    weights = tmp_path_factory.mktemp("labelled") / "weights.safetensors"
    write_weights(weights, {"model": "pacmo", "config": model_config(model)}, model_state(model))
    return weights


def test_the_action_is_told_by_words_of_its_label(labelled: Path, tmp_path: Path) -> None:
    partner, out = tmp_path / "alone.bvh", tmp_path / "out.parquet"
    partner.write_text(format_bvh(CLIP.person_a, 15, SBU15))
    words = [partner, "--weights", labelled, "--out", out]
    said = pacmo(*words)
    assert said.exit_code == 0, said.output
    others = "A1 wave, A2 shake hands, A3 hand over"
    assert f"the action is not told; --action may name one of: {others}\n" in said.stdout
    untold = out.read_bytes()
    said = pacmo(*words, "--action", "SHAKE")
    assert "the action is told: A2 shake hands\n" in said.stdout
    assert out.read_bytes() != untold
    refused(pacmo(*words, "--action", "hand"), f"--action: action must be one of {others}; got 'h")
    assert out.read_bytes() != untold


def test_an_action_is_refused_by_weights_without_labels(weights: Path, tmp_path: Path) -> None:
    partner = tmp_path / "alone.bvh"
    partner.write_text(format_bvh(CLIP.person_a, 15, SBU15))
    words = ["--weights", weights, "--action", "hug", "--out", tmp_path / "out.parquet"]
    refused(pacmo(partner, *words), "--action hug: the weights were not trained with labels")


@pytest.mark.parametrize("person", ["a", "b"])
def test_a_reaction_gets_the_bones_of_the_partner_or_of_the_captured_person(
    weights: Path, tmp_path: Path, person: str
) -> None:
    # Person b is a third taller.
    pair = replace(CLIP, person_b=1.3 * CLIP.person_b)
    stored, out = tmp_path / "pair.parquet", tmp_path / "out.parquet"
    with write_motions(stored, SBU15) as writer:
        writer.add("one", pair)
    words = [stored, "--clip", "one", "--person", person, "--weights", weights, "--out", out]
    people = {"partner": getattr(pair, f"person_{person}"),
              "captured": pair.person_b if person == "a" else pair.person_a}  # fmt: skip
    for body, motion in people.items():
        said = pacmo(*words, "--body", body)
        assert said.exit_code == 0, said.output
        assert f"with the bone lengths of the {body}" in said.stdout
        ((_, made),) = stream_motions(out)
        wanted = np.median(bone_lengths(motion, SBU15), axis=0)
        np.testing.assert_allclose(bone_lengths(made.person_b, SBU15)[9], wanted, rtol=1e-3)


def test_a_body_that_is_not_there_or_not_used_is_refused(weights: Path, tmp_path: Path) -> None:
    partner = tmp_path / "alone.bvh"
    partner.write_text(format_bvh(CLIP.person_a, 15, SBU15))
    words = [partner, "--weights", weights, "--out", tmp_path / "o.parquet"]
    refused(pacmo(*words, "--body", "captured"), "--body captured wants a capture of two people")
    refused(pacmo(*words, "--body", "partner", "--no-finish"), "--body partner: the finish makes")
    both = ["--body", "partner", "--rig", partner]
    refused(pacmo(*words, *both), "alone.bvh and --body partner: wanted one of them")
    refused(pacmo("--stream", "--weights", weights, "--body", "partner"), "leave out --body")
    assert pacmo(*words, "--body", "ben").exit_code == 2


def test_the_temperature_scales_how_much_samples_differ(weights: Path, tmp_path: Path) -> None:
    partner, out = tmp_path / "alone.bvh", tmp_path / "out.parquet"
    partner.write_text(format_bvh(CLIP.person_a, 15, SBU15))
    words = [partner, "--weights", weights, "--samples", 4, "--no-finish", "--out", out]

    def spread(*more: object) -> float:
        assert pacmo(*words, *more).exit_code == 0
        samples = np.stack([pair.person_b for _, pair in stream_motions(out)])
        return float(samples.std(axis=0).mean())

    assert 0 < spread("--temperature", 0.5) < spread() == spread("--temperature", 1)
    before = out.read_bytes()
    refused(pacmo(*words, "--temperature", 3), "--temperature: temperature must be 0 to 2; got 3")
    refused(pacmo(*words, "--temperature", -1), "got -1")
    refused(pacmo(*words, "--temperature", 0), "0 gives one reaction; leave out --samples 4")
    assert out.read_bytes() == before


def test_at_a_temperature_of_0_every_seed_gives_the_same_reaction(
    weights: Path, tmp_path: Path
) -> None:
    partner = tmp_path / "alone.bvh"
    partner.write_text(format_bvh(CLIP.person_a, 15, SBU15))
    words = [partner, "--weights", weights, "--no-finish", "--temperature", 0]
    motions = []
    for seed in (1, 2):
        out = tmp_path / f"{seed}.parquet"
        assert pacmo(*words, "--seed", seed, "--out", out).exit_code == 0
        ((_, pair),) = stream_motions(out)
        motions.append(pair.person_b)
    np.testing.assert_array_equal(*motions)


def test_a_temperature_is_refused_by_weights_without_noise(tmp_path: Path) -> None:
    regression = build_regression_training(clips(4), replace(REGRESSION, n_epochs=1)).finish()
    facts = {"model": "regression", "config": model_config(regression)}
    weights = tmp_path / "weights.safetensors"
    write_weights(weights, facts, model_state(regression))
    partner = tmp_path / "alone.bvh"
    partner.write_text(format_bvh(CLIP.person_a, 15, SBU15))
    words = [partner, "--weights", weights, "--out", tmp_path / "o.parquet"]
    assert pacmo(*words).exit_code == 0
    refused(pacmo(*words, "--temperature", 0.5), "--temperature: the model has no noise")


def test_a_live_partner_is_answered_by_the_action_and_the_temperature(
    labelled: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [json.dumps({"time": t, "pose": p.tolist()})
             for t, p in zip(CLIP.times[:4].tolist(), CLIP.person_a, strict=False)]  # fmt: skip

    def answers(*words: object) -> list[str]:
        command = ["react", "--stream", "--weights", str(labelled), *map(str, words)]
        said = CliRunner().invoke(app, command, input="\n".join([*lines, ""]))
        assert said.exit_code == 0, said.output
        return said.stdout.splitlines()

    untold = answers()
    assert len(untold) == 4
    assert answers("--action", "wave") != untold
    assert answers("--temperature", 0.5) != untold
    cold = answers("--temperature", 0)
    assert cold == answers("--temperature", 0, "--seed", 7) != untold
    command = ["react", "--stream", "--weights", str(labelled), "--action", "hop"]
    refused(CliRunner().invoke(app, command), "--action: action must be one of", "got 'hop'")
