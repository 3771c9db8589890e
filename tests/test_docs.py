"""Truth: the commands as they stand in the documentation, run with small inputs."""

import ast
import json
import os
import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import typer
from ruamel.yaml import YAML
from scipy.io import savemat
from typer.testing import CliRunner

from pacmo_core.commands import view
from pacmo_core.commands.cli import app
from pacmo_core.data.skeleton import SBU15
from pacmo_core.data.splits import ClipOrigin, SplitRule, assign_splits
from pacmo_core.formats.registry import open_format
from pacmo_core.formats.table import Table
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import SplitRecord, read_rows
from pacmo_core.synthesis.script import ACTIONS, file_name, sample_scripts
from tests.commands.test_augment import standing
from tests.docs import PAGES, ROOT, blocks, commands

PACMO = typer.main.get_command(app)
GUIDE = ROOT / "docs" / "guide.md"
WRITTEN = {
    *("seen.html", "both.html", "varied.glb", "varied.csv", "varied.gif"),
    *("duo_A.bvh", "duo_B.bvh", "varied/duo_A.bvh", "varied/duo_B.bvh"),
}
REDIRECTED = re.compile(r"^[<>|&]")


def each_command(*programs: str) -> list[tuple[str, list[str]]]:
    """List what the documentation would have a reader type, by the page."""
    return [
        (page.name, words) for page in PAGES for words in commands(page) if words[:1] == [*programs]
    ]


@pytest.mark.parametrize(("page", "words"), each_command("pacmo"))
def test_a_command_in_the_documentation_is_one_that_pacmo_takes(
    page: str, words: list[str]
) -> None:
    end = next((k for k, word in enumerate(words) if REDIRECTED.match(word)), len(words))
    group, rest = PACMO, words[1:end]
    while hasattr(group, "get_command") and rest and not rest[0].startswith("-"):
        group, rest = group.get_command(None, rest[0]), rest[1:]
        assert group is not None, f"{page}: no command {' '.join(words)}"
    # Parses and checks every option; runs nothing.
    group.make_context(" ".join(words), rest) if rest else None


def test_stages_that_the_documentation_runs_are_in_dvc_yaml() -> None:
    stages = {*YAML(typ="safe").load(ROOT / "dvc.yaml")["stages"], "top_speed"}  # of new_stage.md
    flows = [words[1:] for _, words in each_command("flow")]
    repros = [words[2:] for _, words in each_command("dvc") if words[1:2] == ["repro"]]
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    targets = re.findall(r"targets='\[\"([^\"]+)\"\]'", text)
    named = {word for words in (*flows, *repros, targets) for word in words}
    named = {word.partition("@")[0] for word in named if not word.startswith(("[", "-", "..."))}
    assert {"train_reaction", "cut"} <= named
    assert named <= stages


def test_modules_that_the_documentation_runs_are_there() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    modules = {m for m in re.findall(r"python -m ([a-z_.]+)", text) if m != "stages.top_speed"}
    named = {m.rstrip(".") for m in modules if m.split(".")[0] in ("flows", "benchmarks", "tests")}
    assert len(named) > 3
    assert [m for m in sorted(named) if m.count(".") and find_spec(m) is None] == []


def test_pages_refer_to_pages_and_pictures_that_are_there() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name} refers to {target}"


def anchors(page: Path) -> set[str]:
    """List what links to parts of a page may name: headings as GitHub spells them, and ids."""
    text = page.read_text(encoding="utf-8")
    headings = [
        re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        for heading in re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    ]
    ids = re.findall(r'<a id="([^"]+)"', text)
    return {re.sub(r"[^\w\- ]", "", heading).strip().replace(" ", "-") for heading in headings} | {
        *ids
    }


def test_links_to_a_part_of_a_page_name_one_that_is_there() -> None:
    for page in PAGES:
        for target, part in re.findall(
            r"\]\(([\w./-]*)#([\w-]+)\)", page.read_text(encoding="utf-8")
        ):
            of = page.parent / target if target else page
            assert of.suffix != ".md" or part in anchors(of), f"{page.name}: {target}#{part}"


def test_python_in_the_documentation_compiles_and_imports_names_that_exist() -> None:
    for page in PAGES:
        for block in (block for block in blocks(page) if block.language == "python"):
            for node in ast.walk(ast.parse(block.text, page.name)):
                if isinstance(node, ast.ImportFrom) and node.module:
                    names = {alias.name for alias in node.names}
                    missing = {name for name in names if not can_be_imported(node.module, name)}
                    assert missing == set(), f"{page.name}: {node.module} has no {missing}"


def can_be_imported(module: str, name: str) -> bool:
    imported = import_module(module)
    is_package = hasattr(imported, "__path__")
    return hasattr(imported, name) or (is_package and find_spec(f"{module}.{name}") is not None)


def test_reactions_that_the_documentation_names_are_to_clips_of_the_test_split(
    tmp_path: Path,
) -> None:
    params = YAML(typ="safe").load(ROOT / "params.yaml")
    section = params["synthesise"]
    scripts = sample_scripts(
        section["random_seed"],
        population=section["random_seed"],
        pairs=section["n_pairs"],
        actions=tuple(ACTIONS),
        replications=section["replications"],
    )
    for script, _ in scripts:
        (tmp_path / f"{file_name(script)}.skeleton").touch()
    found = open_format("ntu", params["ingest"]["settings"]).find(tmp_path)
    origins = [ClipOrigin(s.name, s.recording, tuple(filter(None, s.subjects))) for s in found]
    splits = assign_splits(origins, SplitRule(**params["split"]), 1)
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    named = re.findall(r"data/reactions/1/\w+/\d+:(S\d\w+)#[ab]#0", text)
    assert len(named) > 1
    assert {splits[name] for name in named} == {"test"}
    # A longer recording would be cut into clips of other names.
    assert {name[-4:] for name in named} == {"A050"}
    assert not re.search(r"view NAME data/reactions", text)


@pytest.fixture
def captures(tmp_path: Path) -> Path:
    """Write two people who sway, a file a person, in centimetres."""
    people = standing()
    for name, motion in (("A", people.person_a), ("B", people.person_b)):
        text = format_bvh((100 * motion).astype(np.float32), 15, SBU15)
        (tmp_path / f"duo_{name}.bvh").write_text(text)
    return tmp_path


@pytest.mark.slow
def test_the_guide_goes_from_two_bvh_files_to_a_varied_exported_clip(
    captures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(captures)
    monkeypatch.setattr(view.webbrowser, "open", lambda _: True)
    Path("params.yaml").write_text((ROOT / "params.yaml").read_text())
    name = next(commands(GUIDE, "sh"))[2]
    with write_motions(Path("data/clips/motions.parquet"), SBU15) as writer:
        writer.add(name, standing())
    for words in commands(GUIDE, "sh"):
        done = CliRunner().invoke(app, words[1:])
        assert done.exit_code == 0, f"{' '.join(words)}\n{done.output}"
    assert {name for name in WRITTEN if not Path(name).stat().st_size} == set()


def run(folder: Path, words: list[str]) -> str:
    """Run a command as ``./run`` would, which is set up already."""
    program = {"pacmo": ["-m", "pacmo_core.commands.cli"], "dvc": ["-m", "dvc"], "python": []}[
        words[0]
    ]
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(folder),
    }
    done = subprocess.run(
        [sys.executable, *program, *words[1:]],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """Clone the project, edits that are not committed yet too."""
    folder = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", str(ROOT), str(folder)], check=True)
    listed = ["git", "ls-files", "--modified", "--others", "--exclude-standard"]
    changed = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True)
    for name in filter(lambda name: (ROOT / name).is_file(), changed.stdout.split()):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes((ROOT / name).read_bytes())
    return folder


@pytest.mark.slow
@pytest.mark.scheduled
def test_the_guides_of_a_new_data_set_and_a_new_stage_work(clone: Path, captures: Path) -> None:
    folder = clone / "data" / "captures" / "mine"
    folder.mkdir(parents=True)
    # A take of equal content would be refused: in the second they have changed places.
    for take, people in (("hug01", "AB"), ("push01", "BA")):
        for person, source in zip("AB", people, strict=True):
            text = (captures / f"duo_{source}.bvh").read_text()
            (folder / f"{take}_{person}.bvh").write_text(text)
    said = follow(clone, ROOT / "docs" / "new_dataset.md")
    assert "push01" in said
    assert "0 of 0" in said
    splits = read_rows(clone / "data" / "splits" / "1.parquet", SplitRecord)
    assert {row.clip: row.split for row in splits} == {"hug01": "train", "push01": "test"}
    assert (clone / "data" / "variations" / "mine" / "variations.parquet").exists()
    # With skeleton priors, as the page says.
    mine = clone / "experiments" / "mine.yaml"
    priors = "runs: {priors: {datasets: [mine], splits: [random]}}"
    assert f"`{priors}`" in " ".join((ROOT / "docs" / "new_dataset.md").read_text().split())
    mine.write_text(re.sub(r"runs: .*", priors, mine.read_text()))
    run(clone, ["pacmo", "use", "mine"])
    run(clone, ["dvc", "repro", "split_variations"])
    assert (clone / "data" / "priors" / "splits" / "mine" / "random.parquet").exists()
    # On the same clips, so that no other stage has to run.
    said = follow(clone, ROOT / "docs" / "new_stage.md")
    assert "top_speed" in said
    assert "up to date" in run(clone, ["dvc", "repro", "top_speed"])


def test_arrays_of_other_programs_become_tables_of_joints_as_the_guide_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    captures = Path("data/captures/mine")
    captures.mkdir(parents=True)
    positions = np.random.default_rng(0).uniform(-1, 1, (2, 5, 7, 3))  # person, frame, joint, axis
    # All x, all y, all z of person a, then of person b, in millimetres.
    columns = [1000 * positions[who, :, :, axis] for who in (0, 1) for axis in (0, 1, 2)]
    savemat("push01.mat", {"positions": np.concatenate(columns, axis=1)})
    frames = {"frames": positions.swapaxes(0, 1).tolist()}
    Path("hug01.json").write_text(json.dumps(frames))
    names: dict[str, object] = {}
    for block in blocks(ROOT / "docs" / "new_dataset.md"):
        if block.language == "python":
            exec(compile(block.text, "new_dataset.md", "exec"), names)
    hug, push = (Table().read(sequence).interaction for sequence in Table().find(captures))
    x, y, z = np.moveaxis(positions, -1, 0)
    for clip, wanted in ((hug, positions), (push, np.stack([x, z, -y], axis=-1))):
        np.testing.assert_allclose(clip.person_a, wanted[0], atol=1e-6)
        np.testing.assert_allclose(clip.person_b, wanted[1], atol=1e-6)
    assert (hug.fps, push.fps) == (pytest.approx(30), pytest.approx(120))


def follow(folder: Path, page: Path) -> str:
    """Do what a page says: write or lengthen the files that it names, run its commands."""
    said = ""
    for block in blocks(page):
        if block.file:
            path = folder / block.file
            old = path.read_text() if path.exists() else ""
            path.write_text(f"{old.rstrip()}\n\n{block.text}" if old else block.text)
        elif block.language == "sh":
            for line in block.text.splitlines():
                words = line.split()[1:]
                said += run(folder, [*words, "--no-open"] if words[1] == "view" else words)
    return said


def test_the_page_about_clusters_says_what_trust_one_needs():
    text = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
    assert re.search(r"[Cc]onnect to a cluster only if you trust all of its machines", text)
