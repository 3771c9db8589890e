"""Truth: a clean run, byte for byte, and motions in one file as they were made."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pacmo_core.store.cache import Cache
from pacmo_core.store.motions import clip_of_file, read_motion, stream_folder
from pacmo_core.store.tables import read_variations
from stages import augment
from tests.augmentation.sources import flat_source, source
from tests.stages.augmenting import (
    LIMITS,
    cached_clips,
    cached_variations,
    lay_out,
    run,
    solve_in_process,
    spoil,
    write_params,
)

CLIPS = {"one": source(0), "one#0001": source(1), "one1": source(3), "two/a": source(2, n_frames=9)}
SMALL = Path("variations") / "small"


@pytest.fixture(autouse=True)
def in_process(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the bodies of each batch."""
    return solve_in_process(monkeypatch)


@pytest.fixture
def planned(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """List the clips that are planned."""
    names: list[str] = []
    before = augment.plan_variations

    def plan_and_tell(plan, bodies, clip):
        names.append(clip)
        return before(plan, bodies, clip)

    monkeypatch.setattr(augment, "plan_variations", plan_and_tell)
    return names


def test_one_more_clip_is_planned_and_finished_alone_beside_files_that_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, planned: list[str]
) -> None:
    lay_out(tmp_path, {name: clip for name, clip in CLIPS.items() if name != "one1"})
    before = run(tmp_path, monkeypatch)
    del planned[:]
    written = []
    put = Cache.put
    monkeypatch.setattr(
        Cache, "put", lambda cache, key, new: written.append(key) or put(cache, key, new)
    )
    lay_out(tmp_path, CLIPS)
    grown = run(tmp_path, monkeypatch)
    assert planned == ["one1"]
    assert len(written) == 11 + 1  # its variations and its files
    tables = {"variations/small/clips.parquet", "variations/small/variations.parquet"}
    tables.add("metrics.json")
    assert {name: grown[name] for name in before.keys() - tables} == {
        name: data for name, data in before.items() if name not in tables
    }
    new = grown.keys() - before.keys()
    assert {clip_of_file(Path(name)) for name in new} == {"one1"}
    assert run(tmp_path, monkeypatch, clean=True) == grown


def test_a_clip_of_another_clock_is_finished_anew_though_its_variations_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, planned: list[str], in_process: list[int]
) -> None:
    lay_out(tmp_path, {"one": CLIPS["one"]})
    run(tmp_path, monkeypatch)
    del planned[:], in_process[:]
    times = CLIPS["one"].times.copy()
    times[-1] += 0.001  # the rate, a median, stays
    lay_out(tmp_path, {"one": replace(CLIPS["one"], times=times)})
    found = run(tmp_path, monkeypatch)
    assert (planned, in_process) == (["one"], [])
    assert all((motion.times == times).all() for _, motion in stream_folder(SMALL / "motions"))
    assert run(tmp_path, monkeypatch, clean=True) == found


def test_a_clip_of_the_same_motion_under_another_name_is_planned_for_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, planned: list[str]
) -> None:
    lay_out(tmp_path, {"one": CLIPS["one"]})
    run(tmp_path, monkeypatch)
    lay_out(tmp_path, {"one": CLIPS["one"], "same": CLIPS["one"]})
    found = run(tmp_path, monkeypatch)
    assert planned == ["one", "same"]
    assert {row.clip for row in read_variations(SMALL / "variations.parquet")} == {"one", "same"}
    assert run(tmp_path, monkeypatch, clean=True) == found


def test_motions_of_all_clips_stream_in_order_and_are_found_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lay_out(tmp_path, CLIPS)
    run(tmp_path, monkeypatch)
    rows = read_variations(SMALL / "variations.parquet")
    found = dict(stream_folder(SMALL / "motions"))
    assert list(found) == [row.variation for row in rows if row.accepted] == sorted(found)
    assert {clip_of_file(path) for path in (SMALL / "sources").iterdir()} == set(CLIPS)
    for path in (SMALL / "sources").iterdir():
        own = read_motion(path, clip_of_file(path))
        np.testing.assert_array_equal(own.person_a, CLIPS[clip_of_file(path)].person_a)


def test_clips_that_a_run_did_not_use_are_forgotten_and_their_variations_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lay_out(tmp_path, CLIPS)
    run(tmp_path, monkeypatch)
    made, finished = cached_variations(tmp_path), cached_clips(tmp_path)
    assert len(finished) == len(CLIPS)
    lay_out(tmp_path, {"one": CLIPS["one"]})
    run(tmp_path, monkeypatch)
    assert len(cached_clips(tmp_path)) == 1
    assert set(cached_clips(tmp_path)) < set(finished)
    write_params(tmp_path, limits={**LIMITS, "seam_ratio": 0.5})
    run(tmp_path, monkeypatch)
    assert len(cached_clips(tmp_path)) == 1
    assert not set(cached_clips(tmp_path)) & set(finished)
    assert cached_variations(tmp_path) == made


def test_a_refused_clip_is_finished_too_and_has_no_motions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int]
) -> None:
    lay_out(tmp_path, {"flat": flat_source(), "one": CLIPS["one"]})
    first = run(tmp_path, monkeypatch)
    assert in_process
    del in_process[:]
    assert run(tmp_path, monkeypatch) == first
    assert in_process == []
    assert {clip_of_file(path) for path in (SMALL / "sources").iterdir()} == {"flat", "one"}
    assert not any(clip_of_file(path) == "flat" for path in SMALL.glob("[mf]*/*.parquet"))


def test_a_finished_clip_that_was_spoilt_is_written_anew_of_what_was_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int], planned: list[str]
) -> None:
    lay_out(tmp_path, CLIPS)
    clean = run(tmp_path, monkeypatch)
    del in_process[:], planned[:]
    spoil(cached_clips(tmp_path)[0])
    assert run(tmp_path, monkeypatch) == clean
    assert len(planned) == 1
    assert in_process == []
