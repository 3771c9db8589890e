"""Truth: the table of variations, and the motions that one file of each clip holds."""

from pathlib import Path

import numpy as np
import pytest

from pacmo_core.store.motions import motion_file, stream_folder
from pacmo_core.store.tables import SplitRecord, read_variations, write_rows
from stages.common.examples import read_variation_facts, stream_examples
from stages.report.players import gallery
from tests.augmentation.sources import source
from tests.stages.augmenting import lay_out, run, solve_in_process

CLIPS = {"one": source(0), "one1": source(1), "s01/02": source(2)}
SMALL, SIDES = Path("variations") / "small", Path("sides.parquet")


@pytest.fixture(autouse=True)
def varied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in a folder with variations; every other one is trained on."""
    solve_in_process(monkeypatch)
    lay_out(tmp_path, CLIPS)
    run(tmp_path, monkeypatch)
    names = read_variation_facts(SMALL)
    rows = [SplitRecord(n, ("train", "test")[i % 2]) for i, n in enumerate(names)]
    write_rows(SIDES, SplitRecord, rows)


def test_examples_of_both_sides_are_all_variations_in_order_beside_their_sources() -> None:
    sides = [dict(stream_examples(SMALL, SIDES, side)) for side in ("train", "test")]
    motions = dict(stream_folder(SMALL / "motions"))
    assert all(list(side) == sorted(side) for side in sides)
    found = sides[0] | sides[1]
    assert found.keys() == motions.keys()
    rows = {row.variation: row for row in read_variations(SMALL / "variations.parquet")}
    for name, example in found.items():
        assert example.source == rows[name].clip
        np.testing.assert_array_equal(example.variation.person_b, motions[name].person_b)
        np.testing.assert_array_equal(example.template.person_a, CLIPS[example.source].person_a)
        assert example.scales[0].tolist() == list(rows[name].scales_a.values())


def test_a_clip_whose_file_is_missing_is_named() -> None:
    file = motion_file(SMALL / "motions", "one1")
    file.unlink()
    with pytest.raises(FileNotFoundError, match=r"one1\.parquet"):
        list(stream_examples(SMALL, SIDES, "train"))


def test_the_gallery_shows_the_worst_of_each_clip_beside_it() -> None:
    assert len(list(gallery(Path("variations"), 2, 3))) == 2
