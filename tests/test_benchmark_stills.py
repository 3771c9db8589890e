"""Truth: rows of motions that are written by name, and a key that leads back to them."""

import json
from pathlib import Path

import pytest

from benchmarks import stills
from pacmo_core.api import synthesise
from pacmo_core.store.motions import write_motions


def test_pictures_are_numbered_without_names_and_the_key_tells_which_is_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clips = dict(sorted(synthesise(4, random_seed=3).items()))
    skeleton = next(iter(clips.values())).skeleton
    files = {row: tmp_path / f"{row}.parquet" for row in ("first", "second")}
    for file in files.values():
        with write_motions(file, skeleton) as writer:
            for name, clip in clips.items():
                writer.add(name, clip)
    monkeypatch.setenv("PACMO_REAL_DATA", str(tmp_path / "none"))
    rows = [f"{row}={file}" for row, file in files.items()]
    monkeypatch.setattr("sys.argv", ["stills", str(tmp_path / "out"), *rows, "--each", "2"])
    stills.main()
    key = json.loads((tmp_path / "out/key.json").read_text())
    assert sorted(key) == [f"{number:03}" for number in range(1, 5)]
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {f"{n}.png" for n in key}
    for row in files:
        shown = [one["clip"] for one in key.values() if one["row"] == row]
        assert len(set(shown)) == 2 and set(shown) <= clips.keys()
