"""Truth: the motions of all folds are played, and of hundreds of motions a few."""

from pathlib import Path

import numpy as np
import pytest

from pacmo_core.data.names import variation_name
from pacmo_core.store.motions import write_motions
from stages.report.skeleton_prior import MAX_SOURCES, prior_clips, some_sources
from tests.skeleton_prior.examples import SMALL, interaction


def test_the_motions_of_all_folds_are_played(tmp_path: Path) -> None:
    folds = ["cross_interaction_fold1", "cross_interaction_fold2"]
    (tmp_path / "small").mkdir()
    for number, fold in enumerate(folds):
        with write_motions(tmp_path / "small" / f"{fold}.parquet", SMALL) as writer:
            for model in ("kinematic", "solver", "source"):
                writer.add(variation_name(f"clip{number}", model), interaction(number))
    pooled = {"data_facts": {"small": {"cross_interaction": {"folds": folds}}}}
    clips = list(prior_clips(tmp_path, pooled))
    assert [clip.name for clip in clips] == ["small, clip0", "small, clip1"]
    assert [len(clip.panels) for clip in clips] == [3, 3]


@pytest.mark.parametrize("n", [1, MAX_SOURCES, MAX_SOURCES + 1, 282])
def test_of_many_motions_a_few_are_shown_that_lie_evenly(n: int) -> None:
    sources = [f"{number:03d}" for number in range(n)]
    shown = some_sources(sources)
    assert min(n, MAX_SOURCES) / 2 < len(shown) <= MAX_SOURCES
    rows = np.array([int(source) for source in shown])
    assert len(set(np.diff(rows).tolist())) <= 1
