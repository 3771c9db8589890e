"""The clips of a study: which are shown, to whom, and what of them.

A camera's noise tells a capture from a generated motion at a glance, and to a script in the browser
without fail. Both kinds are therefore shown after the same low-pass filter, with bones of constant
length.
"""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.fft import dct, idct

from pacmo_core.commands.study_store import GENERATED, REAL, Candidate, Item
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.names import ReactionName
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.viewer import Scene, packed_scenes
from pacmo_core.project.workspace import MOTIONS, CommandError
from pacmo_core.store.motions import read_motion, stream_motions

CUTOFF_HZ = 2.0
_ROUNDS = 2  # of filter and bones: each disturbs the other a little


def sample_items(
    clips: Path, reactions: Path, count: int, random: np.random.Generator, cutoff: float
) -> Iterator[Item]:
    """Sample captured clips; yield each as captured and with the first reaction of a model.

    Parameters
    ----------
    count : clips
    cutoff : of the filter, hertz

    Raises
    ------
    CommandError
        If there are reactions to too few clips.
    """
    named = ((ReactionName.parse(n), motion) for n, motion in stream_motions(reactions / MOTIONS))
    reacted = {name: motion for name, motion in named if name.sample == 0}
    sources = sorted({name.clip for name in reacted})
    if len(sources) < count:
        raise CommandError(f"{reactions}: wanted reactions to {count} clips; got {len(sources)}")
    for source in random.choice(np.array(sources), count, replace=False).tolist():
        names = [name for name in reacted if name.clip == source]
        name = names[int(random.integers(len(names)))]
        reaction = reacted[name].swapped() if name.direction == "a" else reacted[name]
        yield _item(REAL, source, read_motion(clips / MOTIONS, source), cutoff)
        yield _item(GENERATED, source, reaction, cutoff)


def blinded(interaction: Interaction, cutoff: float) -> Interaction:
    """Return both people without what tells a capture: noise above ``cutoff``, changing bones.

    Parameters
    ----------
    cutoff : hertz
    """
    skeleton = interaction.skeleton
    people = [interaction.person_a, interaction.person_b]
    for _ in range(_ROUNDS):
        people = [low_pass(motion, interaction.fps, cutoff) for motion in people]
        people = [_with_constant_bones(motion, skeleton) for motion in people]
    return Interaction(skeleton, interaction.times, *people)


def low_pass(motion: Motion, fps: float, cutoff: float) -> Motion:
    """Remove all above a frequency from a motion: its cosine transform is cut off there.

    Parameters
    ----------
    motion : (T, J, 3) float32, metres
    fps, cutoff : hertz
    """
    spectrum = dct(motion.astype(np.float64), axis=0, norm="ortho")
    frequencies = np.arange(len(motion)) * fps / (2 * len(motion))
    spectrum[frequencies > cutoff] = 0
    return np.asarray(idct(spectrum, axis=0, norm="ortho"), dtype=np.float32)


def _with_constant_bones(motion: Motion, skeleton: Skeleton) -> Motion:
    """Give every bone its mean length in every frame, in the direction that it has."""
    result = motion.copy()
    for joint in skeleton.order[1:]:
        parent = skeleton.parents[joint]
        bone = motion[:, joint] - motion[:, parent]
        lengths = np.linalg.norm(bone, axis=-1, keepdims=True)
        direction = bone / np.maximum(lengths, np.finfo(np.float32).tiny)
        result[:, joint] = result[:, parent] + lengths.mean() * direction
    return result


def _item(kind: str, source: str, motion: Interaction, cutoff: float) -> Item:
    """Pack a clip without its name and kind."""
    scene = Scene.of("", blinded(motion, cutoff))
    return Item(kind, source, json.dumps(packed_scenes([scene], contact=0.0)))


def balanced_sample(
    candidates: Sequence[Candidate], count: int, random: np.random.Generator
) -> list[int]:
    """Select half of each kind, the least shown first, each source once, in random order.

    Parameters
    ----------
    count : number of clips; if odd, one kind at random has one more

    Raises
    ------
    ValueError
        If there are too few sources.
    """
    order = random.permutation(len(candidates))
    by_times_shown = sorted((candidates[k] for k in order), key=lambda c: c.times_shown)
    expected = {REAL: count // 2, GENERATED: count // 2}
    expected[(REAL, GENERATED)[int(random.integers(2))]] += count % 2
    selected: list[int] = []
    sources: set[str] = set()
    for kind in random.permutation(np.array([REAL, GENERATED])).tolist():
        eligible = [c for c in by_times_shown if c.kind == kind and c.source not in sources]
        if len(eligible) < expected[kind]:
            raise ValueError(f"a participant wants {count} sources; the study has fewer")
        selected += [c.item for c in eligible[: expected[kind]]]
        sources |= {c.source for c in eligible[: expected[kind]]}
    return [selected[k] for k in random.permutation(len(selected))]
