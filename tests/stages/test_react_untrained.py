"""Truth: the copy itself, and a finish that is called by hand."""

import numpy as np

from pacmo_core.finish.finish import finish
from pacmo_core.finish.learning import fitted_on, learn
from pacmo_core.metrics.untrained import TrainingReactions
from stages.react_untrained import finished
from tests.reaction.problems import clips


def test_a_finished_copy_of_a_training_clip_is_of_another(monkeypatch, tmp_path) -> None:
    """Few validation clips: training clips teach too, whose own reaction would teach nothing."""
    training, validation = clips(6), clips(8)[6:]
    data, taught = TrainingReactions.of(training, 9), []
    monkeypatch.setattr("stages.react_untrained.learn", lambda pairs, _: taught.extend(pairs))
    finished(data.nearest, fitted_on(validation, training), training[0].skeleton)
    assert len(taught) == 2 * len([*validation, *training])
    for clip, copy in taught:
        assert np.abs(copy - clip.person_b).max() > 1e-3


def test_a_finished_copy_is_the_copy_finished_by_what_validation_teaches() -> None:
    training, validation, (tested, *_) = clips(6), clips(8)[6:], clips(9)[8:]
    data = TrainingReactions.of(training, 9)
    skeleton = tested.skeleton
    both = [one for clip in validation for one in (clip, clip.swapped())]
    learnt = learn([(clip, data.nearest(clip)) for clip in both], skeleton)
    wanted = finish(data.nearest(tested), tested.person_a, tested.times, skeleton, learnt)
    found = finished(data.nearest, validation, skeleton)(tested)
    np.testing.assert_array_equal(found, wanted)
    assert np.abs(found - data.nearest(tested)).max() > 1e-3
    # Without validation clips nothing is learnt, and bones are exact all the same.
    parent, child = skeleton.bones.T
    alone = finished(data.nearest, [], skeleton)(tested)
    lengths = np.linalg.norm(alone[:, child] - alone[:, parent], axis=-1)
    np.testing.assert_allclose(lengths, lengths[:1] * np.ones_like(lengths), atol=1e-5)
