"""What is trusted: the wheel as pip builds it, and the metadata in pyproject.toml."""

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_wheel_holds_the_library_its_defaults_and_nothing_else(tmp_path):
    tracked = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split("\n")  # fmt: skip
    copy = tmp_path / "copy"  # builds leave folders beside the sources
    for name in filter(lambda name: (ROOT / name).is_file(), tracked):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).write_bytes((ROOT / name).read_bytes())
    # By way of the source distribution, which must hold all that the wheel is built from.
    make = "import setuptools.build_meta as b, sys; print(b.build_sdist(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", make, str(tmp_path)], cwd=copy, check=True)
    (source,) = tmp_path.glob("pacmo-*.tar.gz")
    words = ["pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", str(tmp_path)]
    subprocess.run([sys.executable, "-m", *words, str(source)], check=True)
    (wheel,) = tmp_path.glob("pacmo-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        assert archive.read("pacmo_core/params.yaml") == (ROOT / "params.yaml").read_bytes()
        (entry,) = (name for name in names if name.endswith("entry_points.txt"))
        assert "pacmo = pacmo_core.commands.cli:main" in archive.read(entry).decode()
    top = {name.split("/")[0] for name in names}
    assert {name for name in top if not name.endswith(".dist-info")} == {"pacmo_core"}
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert {"pacmo_core/py.typed", "pacmo_core/figures/three.min.js"} <= set(names)
    weights = "pacmo_core/commands/starting_weights"
    assert {f"{weights}.safetensors", f"{weights}.json"} <= set(names)
    prior = "pacmo_core/commands/starting_prior"
    assert {f"{prior}.safetensors", f"{prior}.json"} <= set(names)


def test_the_lock_has_a_hash_for_every_file_and_names_no_place():
    text = (ROOT / "requirements.lock").read_text()
    pins = [line for line in text.splitlines() if "==" in line]
    assert all(line.endswith(" \\") for line in pins)
    assert text.count("--hash=sha256:") >= len(pins)
    assert "://" not in text and "file:" not in text


def test_the_pipeline_is_an_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    base = " ".join(project["dependencies"])
    assert "dvc" not in base and "prefect" not in base
    assert {"dvc", "prefect"} <= {
        requirement.split(">")[0].split("=")[0]
        for requirement in project["optional-dependencies"]["pipeline"]
    }


@pytest.mark.parametrize("python", ["3.11.0", "3.11.9", "3.12.0", "3.13.0"])
@pytest.mark.parametrize(
    "platform",
    [("linux", "Linux", "x86_64"), ("linux", "Linux", "aarch64"), ("darwin", "Darwin", "arm64")],
)
def test_the_lock_is_complete_on_every_python_and_platform(python, platform):
    """``./run`` installs the lock without dependencies, so that a missing one is found by use."""
    names = ("sys_platform", "platform_system", "platform_machine")
    environment = {
        **default_environment(),
        **dict(zip(names, platform, strict=True)),
        "python_full_version": python,
        "python_version": python.rpartition(".")[0],
    }
    text = (ROOT / "requirements.lock").read_text()
    locked = {canonicalize_name(name) for name in re.findall(r"(?m)^([\w.-]+)==", text)}
    missing = {}
    pending = [(name, "") for name in locked]
    for package, extra in pending:
        try:
            requirements = map(Requirement, metadata.requires(package) or ())
        except metadata.PackageNotFoundError:  # a package of another Python or platform
            continue
        for requirement in requirements:
            marker = requirement.marker
            if marker and not marker.evaluate({**environment, "extra": extra}):
                continue
            if canonicalize_name(requirement.name) not in locked:
                missing[requirement.name] = package
            extras = [(requirement.name, name) for name in requirement.extras]
            pending += [pair for pair in extras if pair not in pending]
    assert not missing
