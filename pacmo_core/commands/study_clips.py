"""The clips of a study: which are shown, to whom, and what of them.

A camera's noise tells a capture from a generated motion at a glance, and to a script in the browser
without fail. The generated motion therefore gets the noise that its capture has, as if the same
camera had seen it, and both kinds are shown after the same low-pass filter, with bones of constant
length.
"""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from pacmo_core.commands.study_store import GENERATED, REAL, Candidate, Item
from pacmo_core.data.interaction import Interaction, Motion
from pacmo_core.data.names import ReactionName
from pacmo_core.data.skeleton import Skeleton
from pacmo_core.figures.viewer import Scene, packed_scenes
from pacmo_core.project.workspace import MOTIONS, CommandError
from pacmo_core.store.motions import read_motion, stream_motions

CUTOFF_HZ = 2.0
NOISE_BAND_HZ = (3.0, 8.0)  # above most motion, and below what cameras filter away
# A joint's error in a depth camera's skeleton is correlated for so long: most of it is below the
# cutoff, where it cannot be told from motion, and follows from its level above.
NOISE_CORRELATION_S = 0.15
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
        capture = read_motion(clips / MOTIONS, source)
        yield _item(REAL, source, capture, cutoff)
        yield _item(GENERATED, source, with_noise_of(capture, reaction, random), cutoff)


def with_noise_of(
    capture: Interaction, reaction: Interaction, random: np.random.Generator
) -> Interaction:
    """Add to both people what they lack of the camera's noise in a capture of the same clip.

    The noise is a first-order autoregression; its level is that of each joint and axis in
    ``NOISE_BAND_HZ``. A person with as much noise as in the capture, such as the partner, stays.
    """
    people = [
        generated + _missing_noise(captured, generated, reaction.fps, random)
        for captured, generated in (
            (capture.person_a, reaction.person_a),
            (capture.person_b, reaction.person_b),
        )
    ]
    a, b = (person.astype(np.float32) for person in people)
    return Interaction(reaction.skeleton, reaction.times, a, b)


def _missing_noise(
    captured: Motion, generated: Motion, fps: float, random: np.random.Generator
) -> NDArray[np.float64]:
    """Sample (T, J, 3) metres: noise of the power by which ``captured`` exceeds ``generated``."""
    powers = [_noise_power(motion, fps) for motion in (captured, generated)]
    level = np.sqrt(np.maximum(powers[0] - powers[1], 0))
    spectrum = np.sqrt(_noise_spectrum(len(generated), fps))[:, None, None]
    noise = idct(spectrum * random.standard_normal(generated.shape), axis=0, norm="ortho")
    return np.asarray(level * noise)


def _noise_power(motion: Motion, fps: float) -> NDArray[np.float64]:
    """Estimate the variance of the noise of each joint and axis, (J, 3) square metres."""
    frequencies = _frequencies(len(motion), fps)
    low, high = NOISE_BAND_HZ
    in_band = (frequencies >= low) & (frequencies <= high)
    if not in_band.any():
        return np.zeros(motion.shape[1:])
    squares = dct(motion.astype(np.float64), axis=0, norm="ortho")[in_band] ** 2
    expected = _noise_spectrum(len(motion), fps)[in_band, None, None]
    return np.asarray((squares / expected).mean(axis=0))


def _noise_spectrum(n_frames: int, fps: float) -> NDArray[np.float64]:
    """Return the variance of each cosine coefficient of an autoregression of variance 1."""
    decay = np.exp(-1 / (fps * NOISE_CORRELATION_S))
    angle = 2 * np.pi * _frequencies(n_frames, fps) / fps
    return np.asarray((1 - decay**2) / (1 - 2 * decay * np.cos(angle) + decay**2))


def _frequencies(n_frames: int, fps: float) -> NDArray[np.float64]:
    """Return the frequencies of a cosine transform, in hertz."""
    return np.arange(n_frames) * fps / (2 * n_frames)


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
    spectrum[_frequencies(len(motion), fps) > cutoff] = 0
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
