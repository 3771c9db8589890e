"""Truth: the table of variations, and the motions that one file of each clip holds."""

from pathlib import Path

import numpy as np
import pytest

from pacmo_core.data.names import split_variation_name
from pacmo_core.figures.variations import variation_label, worst_by_measure
from pacmo_core.store.motions import motion_file, stream_folder
from pacmo_core.store.tables import SplitRecord, read_variations, write_rows
from stages.common.examples import read_variation_facts, stream_examples
from stages.report.players import gallery
from tests.augmentation.sources import source
from tests.stages.augmenting import LIMITS, lay_out, run, solve_in_process, write_params

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


def test_the_gallery_shows_the_worst_by_each_measurement_once_beside_its_source() -> None:
    rows = {row.variation: row for row in read_variations(SMALL / "variations.parquet")}
    worst = worst_by_measure((name, row.measurements) for name, row in rows.items())
    clips = list(gallery(Path("variations"), 5, LIMITS))
    shown = [(clip.name, label) for clip in clips for label in clip.labels[1:]]
    assert sorted(shown) == sorted(
        (f"small, {rows[name].clip}", variation_label(split_variation_name(name)[1]))
        for name in worst
    )
    assert len(worst) > 2
    for clip in clips:
        assert clip.labels[0] == "Source"
        np.testing.assert_array_equal(
            clip.panels[0].interaction.person_a, CLIPS[clip.name.removeprefix("small, ")].person_a
        )
        assert all("is the worst by" in text for _, text in clip.captions)


def test_a_gallery_of_few_panels_goes_on_in_a_further_clip() -> None:
    few = list(gallery(Path("variations"), 1, LIMITS))
    assert all(len(clip.panels) == 2 for clip in few)
    assert len(few) == sum(len(clip.panels) - 1 for clip in gallery(Path("variations"), 5, LIMITS))


def test_a_variation_that_is_left_out_says_for_what(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_params(tmp_path, limits=LIMITS | {"peak_acceleration_ratio": 1e-9})
    run(tmp_path, monkeypatch)
    texts = [text for clip in gallery(Path("variations"), 5, LIMITS) for _, text in clip.captions]
    assert texts
    assert all(text.endswith("left out of training for peak acceleration") for text in texts)
