"""The 967 variations of nine two-person motions of the augmentation paper's dataset.

Li et al. (2024), supplement, section 1: 363 frames each; all bones of one body, or one bone of its
upper body, scaled by 0.75 to 1.25 in steps of 0.05.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from benchmarks._captures import real_data
from pacmo_core.data.interaction import Interaction, joint_distances
from pacmo_core.formats.bvh_pairs import BvhPairs
from pacmo_core.interaction_mesh import Scene, Settings
from pacmo_core.synthesis import ACTIONS, sample_interaction, sample_scripts

N_FRAMES = 363
N_VARIATIONS = 967
SCALES = [scale / 100 for scale in range(75, 130, 5) if scale != 100]
NEAR = 0.25
TAKES = {
    "duo_mocap": (2.0, ("salsa/Easy_01", "salsa/Easy_02", "salsa/Easy_03", "acts/")),
    "cmu_18_19": (None, ("18_10", "18_11", "18_15")),
}
PARAMS = Path(__file__).parents[1] / "params.yaml"
SETTINGS: Settings = TypeAdapter(Settings).validate_python(
    YAML(typ="safe").load(PARAMS)["augment"]["solver"]
)


@dataclass(frozen=True)
class Task:
    """A window and its target bodies: scales (V, E)."""

    name: str
    scene: Scene
    scales: NDArray[np.float64]


def retargeting_tasks() -> tuple[str, list[Task]]:
    """Return the kind of data, and nine windows with about as many variations each."""
    root = real_data()
    real = [window for name in TAKES for window in _windows(root, name)]
    kind, windows = ("real", real) if len(real) == 9 else ("synthetic", _synthetic())
    counts = np.diff(np.linspace(0, N_VARIATIONS, len(windows) + 1).round().astype(int))
    return kind, [
        _task(name, interaction, int(count))
        for (name, interaction), count in zip(windows, counts, strict=True)
    ]


def upper_body(interaction: Interaction) -> list[int]:
    """List the bones above the hips: those on no chain that ends at a foot."""
    skeleton, motion = interaction.skeleton, interaction.person_a
    heights = np.median(motion[..., 1], axis=0)
    ends = set(range(len(skeleton.joints))) - set(skeleton.parents)
    lower = set()
    for end in ends:
        if heights[end] < heights[skeleton.root] and _is_leg(skeleton.joints[end]):
            joint = end
            while joint != skeleton.root:
                lower.add(joint)
                joint = skeleton.parents[joint]
    return [row for row, (_, child) in enumerate(skeleton.bones.tolist()) if child not in lower]


def _is_leg(joint: str) -> bool:
    return any(word in joint.lower() for word in ("toe", "foot", "ankle"))


def _task(name: str, interaction: Interaction, n_variations: int) -> Task:
    """Scale either body as a whole by all scales, then random single bones."""
    scene = Scene(
        (interaction.person_a, interaction.person_b), (interaction.skeleton,) * 2, interaction.fps
    )
    n_bones, n_a = len(scene.bones), scene.n_bones[0]
    upper = upper_body(interaction)
    single = [(bone + body * n_a, s) for body in (0, 1) for bone in upper for s in SCALES]
    random = np.random.default_rng(0)
    selected = random.permutation(len(single))[: n_variations - 2 * len(SCALES)]
    scales = np.ones((n_variations, n_bones))
    for row, scale in enumerate(SCALES):
        scales[2 * row, :n_a] = scale
        scales[2 * row + 1, n_a:] = scale
    for row, which in enumerate(selected, start=2 * len(SCALES)):
        bone, scale = single[which]
        scales[row, bone] = scale
    return Task(name, scene, scales)


def _windows(root: Path, preset: str) -> list[tuple[str, Interaction]]:
    if not (root / preset).is_dir():
        return []
    max_root_distance, takes = TAKES[preset]
    raw_format = BvhPairs(
        preset=preset,
        unit=None,
        up=None,
        fps=None,
        end_sites=False,
        skip_frames=0,
        max_root_distance=max_root_distance,
    )
    sequences = [s for s in raw_format.find(root / preset) if any(take in s.name for take in takes)]
    return [(s.name, _closest(raw_format.read(s).interaction)) for s in sequences]


def _closest(interaction: Interaction) -> Interaction:
    """Return the window with the most near joint pairs."""
    near = (joint_distances(interaction) < NEAR).sum(axis=(1, 2))
    total = np.convolve(near, np.ones(N_FRAMES), mode="valid")
    start = int(total.argmax())
    return interaction.frames(start, start + N_FRAMES)


def _synthetic() -> list[tuple[str, Interaction]]:
    """Return nine synthetic clips of different lengths."""
    actions = tuple(ACTIONS)[-9:]
    scripts = sample_scripts(0, population=0, pairs=1, actions=actions, replications=1)
    return [(script.action, sample_interaction(script, random)) for script, random in scripts]
