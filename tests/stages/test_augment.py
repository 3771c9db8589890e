"""Truth: a clean run, byte for byte; one that was killed, grown or damaged must end as it does."""

import json
import logging
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from benchmarks._retargeting_tasks import SETTINGS
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.formats.write_bvh import format_bvh
from pacmo_core.interaction_mesh import Settings
from pacmo_core.project.experiments import default_params
from pacmo_core.store.motions import motion_file, stream_folder, stream_motions
from pacmo_core.store.tables import ACCEPTED, VARIATIONS, read_variations
from stages.common.params import ParamsError
from tests.augmentation.sources import flat_source, source
from tests.stages.augmenting import (
    COMMAND,
    LIMITS,
    PLAN,
    SECOND,
    cached_clips,
    cached_variations,
    lay_out,
    result,
    run,
    solve_in_process,
    spoil,
    write_params,
)

CLIPS = {"one": source(0), "one#0001": source(1), "two": source(2, n_frames=9)}
GROWN = {
    **PLAN,
    "uniform": [0.9, 0.95, 1.1],
    "n_random": 3,
    "single": {**PLAN["single"], "max_variations": 5},
}
SMALL = Path("variations") / "small"


@pytest.fixture(autouse=True)
def in_process(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the bodies of each batch."""
    return solve_in_process(monkeypatch)


def test_a_thing_that_a_person_holds_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = CLIPS["one"]
    joints, parents = (*bare.skeleton.joints, "object"), (*bare.skeleton.parents, 0)
    ends = zip((bare.person_a, bare.person_b), (0.3, 0.0), strict=True)
    people = [np.concatenate([m, m[:, :1] + np.float32(place)], axis=1) for m, place in ends]
    skeleton = Skeleton(bare.skeleton.name, joints, parents, bare.skeleton.left_right)
    held = replace(bare, skeleton=skeleton, person_a=people[0], person_b=people[1])
    found = []
    for name, clip in (("bare", bare), ("held", held)):
        (tmp_path / name / "clips").mkdir(parents=True)
        lay_out(tmp_path / name, {"one": clip})
        run(tmp_path / name, monkeypatch)
        found.append(dict(stream_motions(motion_file(tmp_path / name / SMALL / ACCEPTED, "one"))))
    assert found[0] and list(found[0]) == list(found[1])
    for first, second in zip(found[0].values(), found[1].values(), strict=True):
        assert second.skeleton.joints == bare.skeleton.joints
        np.testing.assert_array_equal(first.person_a, second.person_a)


def test_further_solutions_are_other_motions_of_the_same_bodies_and_alone_are_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int]
) -> None:
    lay_out(tmp_path, {"one": CLIPS["one"]})
    run(tmp_path, monkeypatch)
    n_bodies = sum(in_process)
    del in_process[:]
    write_params(tmp_path, plan={**PLAN, "solutions": {**PLAN["solutions"], "n": 3}})
    grown = run(tmp_path, monkeypatch)
    assert sum(in_process) == 2 * n_bodies
    folder = tmp_path / SMALL
    accepted = dict(stream_motions(motion_file(folder / ACCEPTED, "one")))
    scales = {row.variation: row.scales_a for row in read_variations(folder / VARIATIONS)}
    first, second, third = (f"one~b-long_arms{end}" for end in ("", "-1", "-2"))
    assert scales[first] == scales[second] == scales[third]
    poses = [accepted[name].person_b for name in (first, second, third)]
    assert len({pose.tobytes() for pose in poses}) == 3
    assert run(tmp_path, monkeypatch, clean=True) == grown


def test_a_plan_that_grows_computes_what_is_new_and_ends_as_a_clean_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int]
) -> None:
    lay_out(tmp_path, CLIPS)
    first = run(tmp_path, monkeypatch)
    n_first, before = sum(in_process), cached_variations(tmp_path)
    assert n_first == len(CLIPS) * (4 + 3 + 2 + 2)

    write_params(tmp_path, plan=GROWN)
    grown = run(tmp_path, monkeypatch)
    assert sum(in_process) - n_first == len(CLIPS) * (2 + 2 + 1)
    assert cached_variations(tmp_path).items() > before.items()

    del in_process[:]
    assert run(tmp_path, monkeypatch) == grown
    assert in_process == []
    write_params(tmp_path)
    assert run(tmp_path, monkeypatch) == first
    assert in_process == []

    write_params(tmp_path, plan=GROWN)
    assert run(tmp_path, monkeypatch, clean=True) == grown


def test_a_clip_that_is_added_costs_itself_alone_and_the_end_is_that_of_a_clean_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int]
) -> None:
    lay_out(tmp_path, {name: CLIPS[name] for name in ("one", "two")})
    run(tmp_path, monkeypatch)
    del in_process[:]
    lay_out(tmp_path, CLIPS)
    grown = run(tmp_path, monkeypatch)
    assert in_process == [11]
    assert run(tmp_path, monkeypatch, clean=True) == grown


def test_a_clip_that_is_gone_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int]
) -> None:
    lay_out(tmp_path, {"clip00": source(0), "clip01": source(1)})
    run(tmp_path, monkeypatch)
    lay_out(tmp_path, {"clip00": source(0)})
    left = run(tmp_path, monkeypatch)
    assert run(tmp_path, monkeypatch, clean=True) == left


def test_other_limits_compute_nothing_and_other_settings_everything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int]
) -> None:
    lay_out(tmp_path, {"one": CLIPS["one"]})
    run(tmp_path, monkeypatch)
    del in_process[:]
    write_params(tmp_path, limits={**LIMITS, "seam_ratio": 0.5})
    run(tmp_path, monkeypatch)
    assert in_process == []
    changed = tmp_path / "params.yaml"
    changed.write_text(changed.read_text().replace("contact_slack: 0.02", "contact_slack: 0.03"))
    assert "contact_slack: 0.03" in changed.read_text()
    run(tmp_path, monkeypatch)
    assert in_process == [11]
    assert len(list((tmp_path / "cache" / "variations").iterdir())) == 1


def test_a_damaged_file_is_made_again_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int],
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    lay_out(tmp_path, CLIPS)
    clean = run(tmp_path, monkeypatch)
    del in_process[:]
    spoilt = tmp_path / next(iter(cached_variations(tmp_path)))
    spoil(spoilt)
    finished = cached_clips(tmp_path)
    for path in finished:
        spoil(path)
    with caplog.at_level(logging.WARNING):
        assert run(tmp_path, monkeypatch) == clean
    assert in_process == [1]
    for path in (spoilt, *finished):
        assert f"{path.relative_to(tmp_path)} is damaged and will be computed again" in caplog.text


def test_files_say_what_was_kept_what_failed_and_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lay_out(tmp_path, {**CLIPS, "flat": flat_source()})
    run(tmp_path, monkeypatch)
    found = [row.measurements for row in read_variations(SMALL / "variations.parquet")]
    middle = float(np.median([figures["primal_residual"] for figures in found if figures]))
    write_params(tmp_path, limits={**LIMITS, "primal_residual": middle})
    run(tmp_path, monkeypatch)
    rows = {row.variation: row for row in read_variations(SMALL / "variations.parquet")}
    good = dict(stream_folder(SMALL / "motions"))
    failed = dict(stream_folder(SMALL / "failed"))
    assert list(rows) == sorted(rows)
    assert set(good) == {name for name, row in rows.items() if row.accepted}
    assert set(failed) == {n for n, row in rows.items() if not row.accepted and row.measurements}
    assert good and failed
    assert all(row.limit_ratio <= 1 for row in rows.values() if row.accepted)
    reasons = [row.reason for row in rows.values() if row.clip == "flat"]
    assert [("refused: person_b is flat" in reason) for reason in reasons] == 11 * [True]
    row = rows["two~b-uniform-1.10"]
    assert set(row.scales_b.values()) == {1.1}
    assert set(row.scales_a.values()) == {1.0}
    clip = (good | failed)["two~b-uniform-1.10"]
    np.testing.assert_array_equal(clip.times, CLIPS["two"].times)
    sources = dict(stream_folder(SMALL / "sources"))
    assert set(sources) == {*CLIPS, "flat"}

    facts = json.loads(Path("metrics.json").read_text())["small"]
    assert facts["planned"] == 44 == facts["accepted"] + facts["failed"] + facts["refused"]
    assert (facts["refused"], facts["refused_clips"]) == (11, ["flat"])
    assert "primal_residual" in facts["failed_by"]
    errors = [row.measurements["near_distance_error"] for row in rows.values()
              if row.kind == "uniform" and row.measurements]  # fmt: skip
    assert facts["kinds"]["uniform"]["near_distance_error"]["mean"] == pytest.approx(
        np.mean(errors)
    )


def test_polars_joins_motions_with_their_facts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lay_out(tmp_path, CLIPS)
    run(tmp_path, monkeypatch)
    facts = pl.read_parquet(SMALL / "variations.parquet").filter(pl.col("accepted"))
    motions = pl.scan_parquet(SMALL.parent / "*/motions/*.parquet").collect()
    joined = motions.join(facts, left_on="clip", right_on="variation")
    assert len(joined) == len(motions)
    assert joined["person_b"].dtype == pl.Array(pl.Float32, (6, 3))


def test_captures_of_another_skeleton_are_a_family_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    duo = {"person_a": "d_A.bvh", "person_b": "d_B.bvh"}
    second = {
        **SECOND, "dataset": "files", "format": "bvh", "clip_seconds": 0.4,
        "settings": {
            "preset": "pair", "unit": 1.0, "up": "y", "fps": None, "end_sites": False,
            "skip_frames": 0, "max_root_distance": None,
        },
    }  # fmt: skip
    lay_out(tmp_path, {"one": CLIPS["one"]}, second_dataset=second)
    own = source(5, n_frames=24)
    for person, name in duo.items():
        (tmp_path / "second" / name).write_text(format_bvh(getattr(own, person), 30, own.skeleton))
    run(tmp_path, monkeypatch)
    files = Path("variations") / "files"
    assert {row.clip for row in read_variations(files / "variations.parquet")} == {
        *("d#0000", "d#0001")
    }
    assert {name for name, _ in stream_folder(files / "sources")} == {"d#0000", "d#0001"}
    assert set(json.loads(Path("metrics.json").read_text())) == {"small", "files"}


def test_plans_that_cannot_be_are_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int]
) -> None:
    lay_out(tmp_path, CLIPS, plan={**PLAN, "uniform": [0.9, 0]})
    with pytest.raises(ParamsError, match="scales of a plan must be positive numbers; got 0"):
        run(tmp_path, monkeypatch)
    write_params(tmp_path, plan={**PLAN, "profiles": ["child"]})
    with pytest.raises(ValueError, match="no thigh to estimate the stature from"):
        run(tmp_path, monkeypatch)
    write_params(
        tmp_path,
        clips={"include": ["x*"], "max_per_sequence": 1, "max_clips": 1, "near_distance": 0.2},
    )
    with pytest.raises(ValueError, match=r"no clip matches x\*"):
        run(tmp_path, monkeypatch)
    assert in_process == []


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_from_its_last_batch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_process: list[int]
) -> None:
    clips = {f"clip{number:02d}": source(number, n_frames=30) for number in range(24)}
    lay_out(tmp_path, clips)
    command = [sys.executable, "-m", "stages.augment", *COMMAND]
    path = os.pathsep.join([str(Path.cwd()), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL
    ) as killed:
        while len(cached_variations(tmp_path)) < 2 and killed.poll() is None:
            time.sleep(0.01)
        killed.send_signal(signal.SIGKILL)
    before = cached_variations(tmp_path)
    assert 2 <= len(before) < len(clips)
    assert not (tmp_path / "metrics.json").exists()

    subprocess.run(command, cwd=tmp_path, env=environment, check=True, capture_output=True)
    assert cached_variations(tmp_path).items() > before.items()
    resumed = result(tmp_path)
    assert run(tmp_path, monkeypatch, clean=True) == resumed
    assert sum(in_process) == len(clips) * 11


def test_the_default_solves_with_the_settings_that_the_benchmark_measures() -> None:
    sections = YAML(typ="safe").load(default_params())
    found = TypeAdapter(Settings).validate_python(sections["augment"]["solver"])
    assert found == SETTINGS
