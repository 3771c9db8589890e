"""Write the code that each stage runs into ``dvc.yaml``, as tests/test_house.py wants it.

Usage: python -m tests.fill_deps

What a stage reads as data stands there by hand and stays; what it imports is found by the same
walk as the test's. A room of the core of which every module is run is named as a whole.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from tests.test_house import FLOORS, ROOT, code_below, is_bare, module_file

CODE = {".py", ".js", ".css", ".html"}


def rooms(files: Iterable[str]) -> set[str]:
    """Name a room of the core in place of its files where all of them are there."""
    found = set(files)
    for room in {str(Path(f).parent) for f in found if f.count("/") == 2}:
        modules = {m for m in (ROOT / room).iterdir() if m.suffix in CODE and not is_bare(m)}
        names = {str(module.relative_to(ROOT)) for module in modules}
        if names <= found:
            found = found - names | {room}
    return found


def code_of(module: str) -> list[str]:
    """List what stands among the dependencies of a stage that runs ``module``."""
    start = module_file(module)
    if start is None:
        raise ValueError(f"wanted a module with code, got {module}")
    files = {file for file in code_below(start) if file is not None}
    folders = {file.parent for file in files if file.parent.name == "figures"}
    pieces = {p for f in folders for p in f.iterdir() if p.suffix in CODE - {".py"}}
    return sorted(rooms(str(path.relative_to(ROOT)) for path in files | pieces))


def fill(stages: dict[str, Any]) -> None:
    """Put every stage's code after its data."""
    for stage in stages.values():
        data = [dep for dep in stage["deps"] if dep.split("/")[0] not in FLOORS]
        stage["deps"].clear()
        stage["deps"].extend([*data, *code_of(stage["cmd"].split()[2])])


def main() -> None:
    """Rewrite ``dvc.yaml``, comments kept."""
    yaml = YAML()
    yaml.width, yaml.preserve_quotes = 110, True
    yaml.indent(mapping=2, sequence=4, offset=2)
    path = ROOT / "dvc.yaml"
    text = yaml.load(path)
    fill(text["stages"])
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(text, file)


if __name__ == "__main__":
    main()
