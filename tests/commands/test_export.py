"""Truth: our own readers of each format; the clip that was written; the page of formats."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from typer.testing import CliRunner, Result

from pacmo_core.commands.cli import app
from pacmo_core.commands.reading import ReadOptions
from pacmo_core.commands.view import read_named_clip
from pacmo_core.data.interaction import Interaction
from pacmo_core.data.skeleton import INTERHUMAN22, NTU25
from pacmo_core.figures.stills import COLOURS
from pacmo_core.figures.viewer import read_asset
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.formats.fit_bones import fit_bones
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.store.motions import write_motions
from tests.formats.moving import moving

FPS = 30.0
CLIP = Interaction(NTU25, np.arange(31) / FPS, moving(NTU25, 1, 31), moving(NTU25, 2, 31))


@pytest.fixture(autouse=True)
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with write_motions(tmp_path / "data/clips/motions.parquet", NTU25) as writer:
        writer.add("one", CLIP)


def export(*words: object) -> Result:
    return CliRunner().invoke(app, ["export", *map(str, words)])


def refused(said: Result, *texts: str) -> None:
    assert said.exit_code == 1, said.output
    assert said.stderr.count("\n") == 1
    for text in texts:
        assert text in said.stderr


@pytest.mark.parametrize(("up", "unit"), [("y", 1.0), ("z", 0.01), ("z", 0.0254), ("y", 0.001)])
def test_a_bvh_goes_in_again_whatever_its_axis_and_unit(
    tmp_path: Path, up: str, unit: float
) -> None:
    said = export("one", "--out", "out/x.bvh", "--to-up", up, "--to-unit", unit)
    assert said.exit_code == 0, said.output
    assert "off by" not in said.stdout, "nothing is"
    pairs = BvhPairs(
        preset="pair", unit=unit, up=up, fps=None, end_sites=False, skip_frames=0,
        max_root_distance=None,
    )  # fmt: skip
    (found,) = pairs.find(tmp_path / "out")
    back = pairs.read(found).interaction
    order = [back.skeleton.joints.index(joint) for joint in NTU25.joints]
    for read, was in ((back.person_a, CLIP.person_a), (back.person_b, CLIP.person_b)):
        far = np.linalg.norm(read[:, order] - was, axis=-1)
        assert far.mean() <= 1e-3
        assert far.max() <= 5e-3


def test_the_command_says_how_far_constant_bones_moved_the_joints(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    shaken = (CLIP.person_a + random.normal(scale=0.01, size=CLIP.person_a.shape)).astype("f4")
    with write_motions(tmp_path / "shaken.parquet", NTU25) as writer:
        writer.add("one", Interaction(NTU25, CLIP.times, shaken, shaken))
    far = np.linalg.norm(fit_bones(shaken, NTU25).positions(NTU25) - shaken, axis=-1) * 1000
    said = [export("shaken.parquet:one", "--out", name).stdout for name in ("x.bvh", "x.glb")]
    for mean, largest in (
        re.findall(r"off by ([\d.]+) mm on average, ([\d.]+)", s)[0] for s in said
    ):
        # All joints are met as well as may be; the plain fit only points each bone.
        assert 0.5 * far.mean() < float(mean) < far.mean()
        assert float(mean) < float(largest) < far.max()
    assert said[0].partition(";")[2] == said[1].partition(";")[2]
    assert "in metres, y up, with the rest pose of a body fitted to the joints" in said[0]


def gltf(file: Path) -> dict:
    content = file.read_bytes()
    if file.suffix == ".glb":
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    return json.loads(content)


def test_each_person_of_a_gltf_is_below_a_node_with_a_name(tmp_path: Path) -> None:
    assert export("one", "--out", "x.glb").exit_code == 0
    document = gltf(tmp_path / "x.glb")
    nodes = document["nodes"]
    scene = [nodes[index] for index in document["scenes"][0]["nodes"]]
    roots = {node["name"]: node["children"] for node in scene if "children" in node}
    assert set(roots) == {"person_a", "person_b"}
    for person, (child,) in roots.items():
        assert nodes[child]["name"] == f"{person[-1]}_{NTU25.joints[NTU25.root]}"
    tops = [nodes[skin["skeleton"]]["name"] for skin in document["skins"]]
    assert tops == ["person_a", "person_b"]


@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_a_gltf_has_two_skins_and_one_animation_of_the_rate_asked_for(
    tmp_path: Path, ending: str
) -> None:
    assert export("one", "--out", f"x{ending}", "--to-fps", 60).exit_code == 0
    document = gltf(tmp_path / f"x{ending}")
    assert len(document["skins"]) == 2
    (animation,) = document["animations"]
    clock = document["accessors"][animation["samplers"][0]["input"]]
    assert clock["count"] == 61
    assert clock["max"] == [1.0]


def test_tables_hold_the_clip_at_the_rate_axis_and_unit_asked_for(tmp_path: Path) -> None:
    words = ["--to-fps", 15, "--to-up", "z", "--to-unit", 0.01]
    assert export("one", "--out", "x.csv", *words).exit_code == 0
    assert export("one", "--out", "x.npz", *words).exit_code == 0
    x, y, z = np.moveaxis(CLIP.person_b[::2], -1, 0)
    wanted = np.stack([x, -z, y], axis=-1) * 100
    with np.load(tmp_path / "x.npz") as found:
        np.testing.assert_allclose(found["person_b"], wanted, atol=1e-3)
        np.testing.assert_allclose(found["times"], CLIP.times[::2], atol=1e-9)
    with (tmp_path / "x.csv").open() as file:
        rows = [row for row in csv.reader(file) if not row[0].startswith("#")]
    assert len(rows) == 1 + 16
    column = rows[0].index("person_b.head.z")
    np.testing.assert_allclose(
        [float(row[column]) for row in rows[1:]],
        wanted[:, NTU25.joints.index("head"), 2],
        atol=1e-3,
    )


@pytest.mark.parametrize("ending", [".npz", ".csv", ".parquet"])
@pytest.mark.parametrize("words", [[], ["--to-up", "z", "--to-unit", 0.01]], ids=["metres", "z"])
def test_a_table_is_a_capture_again_within_a_micrometre(
    tmp_path: Path, ending: str, words: list[object]
) -> None:
    assert export("one", "--out", f"x{ending}", *words).exit_code == 0
    scene = read_named_clip(f"x{ending}", ReadOptions()).scene
    np.testing.assert_allclose(scene.times, CLIP.times, atol=1e-6)
    for back, was in zip(scene.people, (CLIP.person_a, CLIP.person_b), strict=True):
        np.testing.assert_allclose(back, was, atol=1e-6)
    # And from the table, as from any capture.
    assert export(f"x{ending}", "--out", "again.npz").exit_code == 0
    with np.load("again.npz") as found:
        np.testing.assert_allclose(found["person_b"], CLIP.person_b, atol=1e-6)


def test_a_table_that_lacks_frames_is_written_at_their_times(tmp_path: Path) -> None:
    kept = np.delete(np.arange(31), [10, 11, 12])
    lossy = Interaction(NTU25, CLIP.times[kept], CLIP.person_a[kept], CLIP.person_b[kept])
    with write_motions(tmp_path / "lossy.parquet", NTU25) as writer:
        writer.add("lossy", lossy)
    assert export("lossy.parquet:lossy", "--out", "lossy.npz").exit_code == 0
    said = export("lossy.npz", "--out", "x.bvh")
    assert said.exit_code == 0, said.output
    assert said.stderr.count("lossy.npz: 3 frames are missing, most after 0.3 s") == 1
    assert "31 frames at 30 frames a second" in said.stdout
    whole = BvhPairs(
        preset="pair", unit=1.0, up="y", fps=None, end_sites=False, skip_frames=0,
        max_root_distance=None,
    )  # fmt: skip
    (found,) = whole.find(tmp_path)
    roots = whole.read(found).interaction.person_a[kept, 0]
    np.testing.assert_allclose(roots, lossy.person_a[:, 0], atol=1e-3)


@pytest.mark.parametrize("ending", [".npz", ".csv", ".parquet"])
def test_a_person_alone_stays_alone_in_a_table(tmp_path: Path, ending: str) -> None:
    (tmp_path / "x.bvh").write_text(format_bvh(CLIP.person_a, FPS, NTU25))
    words = ["--from-unit", 1, "--from-up", "y"]
    assert export("x.bvh", *words, "--out", f"x{ending}").exit_code == 0
    assert len(read_named_clip(f"x{ending}", ReadOptions()).scene.people) == 1


@pytest.mark.slow
def test_a_picture_shows_sixteen_instants_of_both_people(tmp_path: Path) -> None:
    result = export("one", "--out", "x.png")
    assert result.exit_code == 0 and "x.png: sixteen instants" in result.output
    with Image.open(tmp_path / "x.png") as found:
        pixels = np.asarray(found.convert("RGB"), float) / 255
    blue, vermilion = (np.array(to_rgb(colour)) for colour in COLOURS)
    height, width = (size // n for size, n in zip(pixels.shape, (4, 4), strict=False))
    for row in range(4):
        for column in range(4):
            part = pixels[row * height :, column * width :][:height, :width]
            for colour in (blue, vermilion):
                assert (np.abs(part / part.max() - colour).max(axis=-1) < 0.15).sum() > 50


def test_a_gif_has_25_frames_a_second_if_nothing_else_is_asked(tmp_path: Path) -> None:
    assert export("one", "--out", "x.gif").exit_code == 0
    with Image.open(tmp_path / "x.gif") as found:
        assert (found.n_frames, found.info["duration"]) == (26, 40)


PLACED = [
    ("x.npz", []),
    ("x.csv", ["--to-up", "z", "--to-unit", 0.01]),
    ("x.bvh", ["--to-unit", 0.01]),
]


@pytest.mark.parametrize(("name", "words"), PLACED)
def test_ground_and_centre_move_both_people_alike(
    tmp_path: Path, name: str, words: list[object]
) -> None:
    assert export("one", "--out", name, "--ground", "--centre", *words).exit_code == 0
    files = "x_A.bvh+x_B.bvh" if name == "x.bvh" else name
    told = ReadOptions(unit=["cm"], up=["y"]) if name == "x.bvh" else ReadOptions()
    scene = read_named_clip(files, told).scene
    order = [scene.skeleton.joints.index(joint) for joint in NTU25.joints]
    people = np.stack(scene.people)[:, :, order]
    assert people[..., 1].min() == pytest.approx(0, abs=1e-5)
    roots = people[:, :, NTU25.root].mean(axis=(0, 1))
    np.testing.assert_allclose(roots[[0, 2]], 0, atol=1e-5)
    moved = people - np.stack([CLIP.person_a, CLIP.person_b])
    np.testing.assert_allclose(moved, np.broadcast_to(moved[0, 0, 0], moved.shape), atol=1e-4)


def test_a_film_shows_the_people_in_the_colours_of_the_viewer(tmp_path: Path) -> None:
    css = read_asset("player.css")
    viewer = [re.search(rf"--person-{person}: (#\w+)", css) for person in "ab"]
    assert [found[1] for found in viewer if found] == list(COLOURS)
    # Person a walks on the left of person b.
    with write_motions(tmp_path / "two.parquet", NTU25) as writer:
        right = CLIP.person_a + np.array([4, 0, 0], np.float32)
        writer.add("one", Interaction(NTU25, CLIP.times, CLIP.person_a, right))
    assert export("two.parquet:one", "--out", "x.gif", "--to-fps", 5).exit_code == 0
    with Image.open(tmp_path / "x.gif") as found:
        picture = np.asarray(found.convert("RGB")).astype(int)
    blue = picture[..., 2] - picture[..., 0] > 60
    orange = picture[..., 0] - picture[..., 2] > 60
    assert np.nonzero(blue)[1].mean() < np.nonzero(orange)[1].mean()


@pytest.mark.parametrize("name", ["x.png", "x.gif"])
def test_two_people_of_different_skeletons_are_shown_in_pictures_and_films(
    tmp_path: Path, name: str
) -> None:
    other = moving(INTERHUMAN22, 2, 31) + np.array([4, 0, 0], np.float32)
    (tmp_path / "a.bvh").write_text(format_bvh(CLIP.person_a, FPS, NTU25))
    (tmp_path / "b.bvh").write_text(format_bvh(other, FPS, INTERHUMAN22))
    words = ["--from-unit", 1, "--from-up", "y", *(["--to-fps", 5] if name == "x.gif" else [])]
    said = export("a.bvh+b.bvh", *words, "--out", name)
    assert said.exit_code == 0, said.output
    joined = (tmp_path / name).read_bytes()
    assert export("a.bvh", "b.bvh", *words, "--out", name).exit_code == 0
    assert (tmp_path / name).read_bytes() == joined
    with Image.open(tmp_path / name) as found:
        picture = np.asarray(found.convert("RGB")).astype(int)
    if name == "x.png":
        picture = picture[: picture.shape[0] // 4, : picture.shape[1] // 4]
    blue = picture[..., 2] - picture[..., 0] > 60
    orange = picture[..., 0] - picture[..., 2] > 60
    assert np.nonzero(blue)[1].mean() < np.nonzero(orange)[1].mean()
    said = export("a.bvh+b.bvh", *words[:4], "--out", "x.csv")
    # The random body of b is doubted too.
    assert said.exit_code == 1 and said.stderr.count("\n") == 2
    assert all(text in said.stderr for text in ("a + b", ".csv holds one", ".png"))


def test_ground_and_centre_are_told_apart(tmp_path: Path) -> None:
    assert export("one", "--out", "g.npz", "--ground").exit_code == 0
    assert export("one", "--out", "c.npz", "--centre").exit_code == 0
    with np.load("g.npz") as ground, np.load("c.npz") as centre:
        np.testing.assert_array_equal(ground["person_a"][..., [0, 2]], CLIP.person_a[..., [0, 2]])
        np.testing.assert_array_equal(centre["person_a"][..., 1], CLIP.person_a[..., 1])


@pytest.mark.parametrize("name", ["x.bvh", "x.glb", "x.csv", "x.npz"])
def test_the_command_says_the_frames_and_their_rate(tmp_path: Path, name: str) -> None:
    assert "31 frames at 30 frames a second" in export("one", "--out", name).stdout
    assert "16 frames at 15 frames" in export("one", "--out", name, "--to-fps", 15).stdout


def test_what_a_format_cannot_hold_is_refused_before_any_work(tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())
    refused(export("one", "--out", "x.fbx"), "x.fbx", ".glb")
    refused(export("one", "--out", "x.glb", "--to-up", "z"), "always metres, y up")
    refused(export("one", "--out", "x.gif", "--to-unit", 0.01), "always metres, y up")
    refused(export("one", "--out", "x.gif", "--ground"), "a film has no origin", "--ground")
    refused(export("one", "--out", "x.png", "--centre"), "a picture has no origin", "--centre")
    refused(export("one", "--out", "x.png", "--to-fps", 5), "a picture has no frame rate")
    refused(export("one", "--out", "x.gif", "--to-fps", 30), "33.333")
    refused(export("data/clips:one", "--out", "data/clips/motions.parquet"), "would overwrite")
    refused(export("one", "--out", "x.bvh", "--to-up", "x"), "--to-up: wanted y or z; got 'x'")
    refused(export("one", "--out", "x.csv", "--to-unit", 0), "unit must be")
    refused(export("one", "--out", "x.csv", "--to-fps", 0), "fps must be")
    refused(export("two", "--out", "x.csv"), "no clip two")
    refused(export("one", "two", "three", "--out", "x.csv"), "files of two people", "three")
    assert sorted(tmp_path.iterdir()) == before
