"""BVH and glTF of BVH. Truth: the files that were exported; SciPy's slerp between their frames."""

import base64
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from typer.testing import CliRunner, Result

from pacmo_core.commands import export as command
from pacmo_core.commands.cli import app
from pacmo_core.formats.bvh import Bvh, read_bvh
from pacmo_core.formats.bvh_channels import format_file, local_rotations
from pacmo_core.formats.resample import from_y_up
from tests.formats.rigged import t_pose

N_FRAMES, FPS = 7, 30
CM = ["--from-unit", "cm", "--from-up", "y"]


def export(*words: object) -> Result:
    return CliRunner().invoke(app, ["export", *map(str, words)])


@pytest.fixture
def duo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Write two people with fingers, in a T-pose of rest and moving, whose roots have offsets."""
    monkeypatch.chdir(tmp_path)
    files = [Path("anna.bvh"), Path("ben.bvh")]
    for number, file in enumerate(files):
        file.write_text(t_pose(1 - 0.1 * number).replace("OFFSET 0 0 0", "OFFSET 0 97 0", 1))
        rest = read_bvh(file)
        random = np.random.default_rng(number)
        rows = np.cumsum(random.normal(scale=4, size=(N_FRAMES, rest.motion.shape[1])), axis=0)
        rows[:, :3] += rest.motion[0, :3] + [90.0 * number, 0, 0]
        file.write_text(format_file(replace(rest, frame_time=1 / FPS), rows))
    return files


@pytest.fixture
def no_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fail where rotations are fitted."""

    def fail(*_: object) -> None:
        raise AssertionError("fitted")

    monkeypatch.setattr(command, "fit_bones", fail)


def bones(bvh: Bvh) -> np.ndarray:
    positions = bvh.positions()
    child = [row for row, parent in enumerate(bvh.parents) if parent >= 0]
    parents = [bvh.parents[row] for row in child]
    return np.linalg.norm(positions[:, child] - positions[:, parents], axis=-1)


def with_head(file: Path) -> tuple[Bvh, int, int]:
    """Read a file; return it, its head, and the head's first column of the motion."""
    given = read_bvh(file)
    head = given.joints.index("mixamorig:Head")
    return given, head, sum(len(channels) for channels in given.channels[:head])


def check_kept(found: Bvh, given: Bvh, offsets: np.ndarray) -> None:
    for name in ("joints", "parents", "channels", "end_sites"):
        assert getattr(found, name) == getattr(given, name)
    np.testing.assert_allclose(found.offsets, offsets, atol=1e-5)


@pytest.mark.usefixtures("no_fit")
@pytest.mark.parametrize(
    ("words", "unit", "up"),
    [
        ([], 1.0, "y"),
        (["--to-unit", "cm"], 0.01, "y"),
        (["--to-unit", "in", "--to-up", "z"], 0.0254, "z"),
    ],
)
def test_files_are_on_their_own_rigs_in_any_unit_and_axes(
    duo: list[Path], words: Sequence[str], unit: float, up: str
) -> None:
    said = export("anna.bvh+ben.bvh", *CM, *words, "--out", "x.bvh")
    assert said.exit_code == 0, said.output
    assert "with the rest pose of anna.bvh and ben.bvh" in said.stdout
    assert f"{up} up" in said.stdout.splitlines()[-1]
    for file, name in zip(duo, "AB", strict=True):
        given, found = read_bvh(file), read_bvh(Path(f"x_{name}.bvh"))
        check_kept(found, given, from_y_up(given.offsets, up) * (0.01 / unit))
        wanted = from_y_up(0.01 * given.positions(), up)
        np.testing.assert_allclose(unit * found.positions(), wanted, atol=1e-4)
        assert found.frame_time == pytest.approx(given.frame_time, rel=1e-7)
        if up == "y":
            turned = found.motion[:, 3:] - given.motion[:, 3:]
            np.testing.assert_allclose(turned, 0, atol=1e-5)


@pytest.mark.usefixtures("no_fit")
def test_frames_between_those_of_the_file_are_on_the_slerp(duo: list[Path]) -> None:
    said = export("anna.bvh+ben.bvh", *CM, "--to-unit", "cm", "--to-fps", 60, "--out", "x.bvh")
    assert said.exit_code == 0, said.output
    assert "13 frames at 60 frames a second, in centimetres, y up" in said.stdout
    times, at = np.arange(N_FRAMES) / FPS, np.arange(2 * N_FRAMES - 1) / (2 * FPS)
    for file, name in zip(duo, "AB", strict=True):
        given, found = read_bvh(file), read_bvh(Path(f"x_{name}.bvh"))
        check_kept(found, given, given.offsets)
        np.testing.assert_allclose(found.positions()[::2], given.positions(), atol=1e-2)
        np.testing.assert_allclose(bones(found), bones(given)[:1].repeat(len(at), 0), atol=1e-3)
        was, now = local_rotations(given), local_rotations(found)
        for joint in range(len(given.joints)):
            wanted = Slerp(times, Rotation.from_matrix(was[:, joint]))(at.clip(0, times[-1]))
            np.testing.assert_allclose(now[:, joint], wanted.as_matrix(), atol=1e-5)


@pytest.mark.usefixtures("no_fit")
def test_twice_a_rate_keeps_the_frames_of_a_file_whose_frame_time_is_rounded(
    duo: list[Path],
) -> None:
    given = read_bvh(duo[0])
    rows = np.concatenate([given.motion] * 40)
    text = format_file(replace(given, frame_time=1 / FPS), rows)
    duo[0].write_text(text.replace("Frame Time: 0.0333333333", "Frame Time: 0.033333"))
    said = export("anna.bvh", *CM, "--to-unit", "cm", "--to-fps", 60, "--out", "x.bvh")
    assert said.exit_code == 0, said.output
    assert "559 frames at 60 frames a second" in said.stdout
    np.testing.assert_allclose(read_bvh(Path("x.bvh")).motion[::2], rows, atol=1e-5)


@pytest.mark.usefixtures("no_fit", "duo")
def test_ground_and_centre_move_both_rigs_alike() -> None:
    words = [*CM, "--to-up", "z", "--ground", "--centre"]
    for clip in ("anna.bvh+ben.bvh", "anna.bvh"):
        assert export(clip, *words, "--out", "x.bvh").exit_code == 0
        assert export(clip, *words, "--out", "x.glb").exit_code == 1  # always y up
        names = ["x_A.bvh", "x_B.bvh"] if "+" in clip else ["x.bvh"]
        people = [read_bvh(Path(name)) for name in names]
        joints = [np.delete(person.positions(), person.end_sites, axis=1) for person in people]
        assert min(body[..., 2].min() for body in joints) == pytest.approx(0, abs=1e-5)
        roots = np.mean([body[:, 0] for body in joints], axis=(0, 1))
        np.testing.assert_allclose(roots[:2], 0, atol=1e-5)
        shifts = [
            person.positions() - from_y_up(0.01 * read_bvh(Path(name)).positions(), "z")
            for person, name in zip(people, ("anna.bvh", "ben.bvh"), strict=False)
        ]
        for shift in shifts:
            assert np.abs(shift - shifts[0][0, 0]).max() < 1e-4


@pytest.mark.usefixtures("no_fit")
def test_people_of_two_frame_rates_are_both_on_their_rigs_at_the_lower(duo: list[Path]) -> None:
    given = read_bvh(duo[1])
    half = replace(given, frame_time=2 / FPS)
    duo[1].write_text(format_file(half, given.motion[::2]))
    assert export("anna.bvh+ben.bvh", *CM, "--to-unit", "cm", "--out", "x.bvh").exit_code == 0
    anna, ben = (read_bvh(Path(f"x_{name}.bvh")) for name in "AB")
    np.testing.assert_allclose(anna.motion, read_bvh(duo[0]).motion[::2], atol=1e-5)
    np.testing.assert_allclose(ben.motion, given.motion[::2], atol=1e-5)


def test_a_rig_that_cannot_be_resampled_is_fitted_and_the_command_says_why(
    duo: list[Path],
) -> None:
    given, head, first = with_head(duo[0])
    channels = list(given.channels)
    channels[head] = channels[head][:1]
    rows = np.delete(given.motion, [first + 1, first + 2], axis=1)
    duo[0].write_text(format_file(replace(given, channels=tuple(channels)), rows))
    words = ["anna.bvh", *CM, "--out", "x.bvh"]
    assert "with the rest pose of anna.bvh" in export(*words).stdout
    said = export(*words, "--to-fps", 60)
    assert said.exit_code == 0, said.output
    assert "with the rest pose of a body fitted to the joints (anna.bvh: " in said.stdout
    assert "Head has 1 rotation axes" in said.stdout


def gltf_nodes(file: Path) -> tuple[dict, dict[str, dict[str, np.ndarray]]]:
    """Read a glTF file: nodes by name, and the channels of each, by path."""
    document = json.loads(file.read_text())
    data = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])

    def values(index: int) -> np.ndarray:
        accessor = document["accessors"][index]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
        start = document["bufferViews"][accessor["bufferView"]]["byteOffset"]
        numbers = np.frombuffer(data, np.float32, accessor["count"] * width, start)
        return numbers.reshape(-1, width)

    (animation,) = document["animations"]
    channels: dict[str, dict[str, np.ndarray]] = {}
    for channel in animation["channels"]:
        name = document["nodes"][channel["target"]["node"]]["name"]
        found = values(animation["samplers"][channel["sampler"]]["output"])
        channels.setdefault(name, {})[channel["target"]["path"]] = found
    bind = [values(skin["inverseBindMatrices"]).reshape(-1, 4, 4) for skin in document["skins"]]
    return {node["name"]: node for node in document["nodes"]} | {"bind": bind}, channels


@pytest.mark.usefixtures("no_fit")
def test_gltf_of_bvh_has_its_rest_pose_and_its_rotations(duo: list[Path]) -> None:
    said = export("anna.bvh+ben.bvh", *CM, "--out", "x.gltf")
    assert said.exit_code == 0, said.output
    assert "in metres, y up, with the rest pose of anna.bvh and ben.bvh" in said.stdout
    nodes, channels = gltf_nodes(Path("x.gltf"))
    for number, file in enumerate(duo):
        given = read_bvh(file)
        local, rest = local_rotations(given), np.zeros((len(given.joints), 3))
        joints = [joint for joint in range(len(given.joints)) if joint not in given.end_sites]
        for joint in joints:
            node = f"{'ab'[number]}_{given.joints[joint]}"
            turned = Rotation.from_quat(channels[node]["rotation"]).as_matrix()
            np.testing.assert_allclose(turned, local[:, joint], atol=1e-6)
            assert "rotation" not in nodes[node]
            if joint:
                offset = 0.01 * given.offsets[joint]
                np.testing.assert_allclose(nodes[node]["translation"], offset, atol=1e-7)
                rest[joint] = rest[given.parents[joint]] + offset
            else:
                root = channels[node]["translation"]
                np.testing.assert_allclose(root, 0.01 * given.positions()[:, 0], atol=1e-6)
        bind = nodes["bind"][number]
        np.testing.assert_allclose(bind[:, 3, :3], -rest[joints], atol=1e-6)


@pytest.mark.usefixtures("no_fit", "duo")
def test_gltf_of_bvh_at_another_rate_stands_on_the_floor_if_asked() -> None:
    words = [*CM, "--to-fps", 60, "--ground"]
    assert export("anna.bvh+ben.bvh", *words, "--out", "x.gltf").exit_code == 0
    assert export("anna.bvh+ben.bvh", *words, "--out", "x.bvh").exit_code == 0
    _, channels = gltf_nodes(Path("x.gltf"))
    lowest = []
    for person, name in zip("ab", "AB", strict=True):
        of_bvh = read_bvh(Path(f"x_{name}.bvh"))
        places = np.delete(of_bvh.positions(), of_bvh.end_sites, axis=1)
        root = channels[f"{person}_{of_bvh.joints[0]}"]["translation"]
        np.testing.assert_allclose(root, places[:, 0], atol=1e-5)
        lowest.append(places[..., 1].min())
    assert len(root) == 2 * N_FRAMES - 1
    assert min(lowest) == pytest.approx(0, abs=1e-5)


def test_a_root_that_cannot_be_moved_is_fitted_where_it_shall_be(duo: list[Path]) -> None:
    given = read_bvh(duo[0])
    channels = (given.channels[0][3:], *given.channels[1:])
    fixed = replace(given, channels=channels, motion=given.motion[:, 3:])
    duo[0].write_text(format_file(fixed, fixed.motion))
    for name in ("x.bvh", "x.glb"):
        said = export("anna.bvh", *CM, "--ground", "--out", name)
        assert said.exit_code == 0, said.output
        assert "fitted to the joints (anna.bvh: mixamorig:Hips has no position" in said.stdout


@pytest.mark.usefixtures("no_fit")
@pytest.mark.parametrize("fps", [25, 60, 240])
def test_gltf_of_a_long_take_of_a_rounded_rate_has_a_time_for_each_frame(
    duo: list[Path], fps: int
) -> None:
    given = read_bvh(duo[0])
    many = np.resize(given.motion, (1501, given.motion.shape[1]))
    text = format_file(replace(given, frame_time=0.033333), many)
    duo[0].write_text(text)
    said = export("anna.bvh", *CM, "--to-fps", fps, "--out", "x.gltf")
    assert said.exit_code == 0, said.output
    document = json.loads(Path("x.gltf").read_text())
    (animation,) = document["animations"]
    counts = {
        document["accessors"][sampler[end]]["count"]
        for sampler in animation["samplers"]
        for end in ("input", "output")
    }
    assert counts == {50 * fps + 1}


@pytest.mark.usefixtures("no_fit")
@pytest.mark.parametrize("rate", [(), ("--to-fps", FPS)])
def test_keys_of_gltf_and_times_of_a_table_are_on_the_frames_of_the_printed_rate(
    duo: list[Path], rate: tuple[object, ...]
) -> None:
    rounded = duo[0].read_text().replace("Frame Time: 0.0333333333", "Frame Time: 0.033333")
    assert rounded != duo[0].read_text()
    duo[0].write_text(rounded)
    for out in ("x.gltf", "x.csv"):
        said = export("anna.bvh", *CM, *rate, "--out", out)
        assert said.exit_code == 0, said.output
        assert f"{N_FRAMES} frames at {FPS} frames a second" in said.stdout
    document = json.loads(Path("x.gltf").read_text())
    (animation,) = document["animations"]
    inputs = {sampler["input"] for sampler in animation["samplers"]}
    ends = {document["accessors"][number]["max"][0] for number in inputs}
    assert list(ends) == pytest.approx([(N_FRAMES - 1) / FPS], abs=1e-7)
    assert f"# fps: {FPS}\n" in Path("x.csv").read_text()


def test_gltf_of_a_rig_whose_bones_change_is_fitted_and_the_command_says_why(
    duo: list[Path],
) -> None:
    given, head, first = with_head(duo[0])
    channels = list(given.channels)
    channels[head] = ("xposition", "yposition", "zposition", *channels[head])
    places = given.offsets[head] + np.linspace(0, 1, N_FRAMES)[:, None]
    rows = np.insert(given.motion, [first], places, axis=1)
    duo[0].write_text(format_file(replace(given, channels=tuple(channels)), rows))
    assert "with the rest pose of anna.bvh" in export("anna.bvh", *CM, "--out", "x.bvh").stdout
    said = export("anna.bvh", *CM, "--out", "x.glb")
    assert said.exit_code == 0, said.output
    assert (
        "a body fitted to the joints (anna.bvh: the bone to mixamorig:Head changes" in said.stdout
    )


@pytest.mark.parametrize(
    ("seconds", "rows"), [("0.1:0.16667", [3, 4, 5]), (":0.07", [0, 1, 2]), ("0.1:", [3, 4, 5, 6])]
)
def test_a_part_has_the_frames_of_the_files(duo, no_fit, seconds, rows):
    done = export(*duo, "--seconds", seconds, "--out", "part.bvh", *CM, "--to-unit", "cm")
    assert done.exit_code == 0, done.output
    for file, person in zip(duo, "AB", strict=True):
        part, whole = read_bvh(Path(f"part_{person}.bvh")), read_bvh(file)
        assert part.joints == whole.joints
        np.testing.assert_allclose(part.motion, whole.motion[rows], atol=1e-4)


def test_a_part_that_would_end_later_than_the_clip_ends_with_it(duo, no_fit):
    done = export(*duo, "--seconds", "0.1:9", "--out", "part.bvh", *CM)
    assert "--seconds 0.1:9: anna + ben ends at 0.2 s" in done.output
    assert len(read_bvh(Path("part_A.bvh")).motion) == 4


@pytest.mark.parametrize("out", ["part.bvh", "part.npz"])
def test_a_part_of_a_part_is_that_part_of_the_whole(duo, out):
    files = [out] if out.endswith("npz") else ["part_A.bvh", "part_B.bvh"]
    given = [] if out.endswith("npz") else ["--from-unit", "m", "--from-up", "y"]
    assert export(*duo, "--seconds", "0.03:0.2", "--out", out, *CM).exit_code == 0
    assert export(*files, "--seconds", "0.06:0.1", "--out", "again.csv", *given).exit_code == 0
    assert export(*duo, "--seconds", "0.1:0.14", "--out", "once.csv", *CM).exit_code == 0
    again, once = (np.genfromtxt(f, delimiter=",") for f in ("again.csv", "once.csv"))
    np.testing.assert_allclose(again, once, atol=1e-4)


@pytest.mark.parametrize(
    ("seconds", "message"),
    [
        ("3", "--seconds: wanted FIRST:LAST, such as 3:7.5 or 3:; got '3'"),
        ("3 7.5", "--seconds: wanted FIRST:LAST, such as 3:7.5 or 3:; got '3'"),
        ("a:b", "got 'a:b'"),
        ("nan:1", "two frames or more"),
        ("0.19:0.2", "two frames or more of anna + ben, which has 0.2 s; got 0.19:0.2"),
        ("0.1:0.05", "two frames or more"),
    ],
)
def test_what_is_no_part_is_refused(duo, seconds, message):
    done = export(*duo, "--seconds", *seconds.split(), "--out", "part.bvh", *CM)
    assert done.exit_code == 1
    assert message in done.output
    assert not Path("part_A.bvh").exists()
