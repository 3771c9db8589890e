"""The models by name: our form, the paper's, and the supplement's four baselines."""

from collections.abc import Callable
from typing import TypedDict

from pacmo_core.skeleton_prior.frame_baselines import FrameCnn, FrameGcn
from pacmo_core.skeleton_prior.kinematic import KinematicCharacter
from pacmo_core.skeleton_prior.model import PriorConfig, SkeletonPrior
from pacmo_core.skeleton_prior.motion_baselines import MotionCnn, MotionGcn
from pacmo_core.skeleton_prior.paper import First, Second

# Our form is told so much that it needs a quarter of the paper's channels, a sixteenth of its work.
NARROWER, LEAST_HIDDEN = 4, 16


class Sizes(TypedDict):
    """What most networks want to know of a configuration."""

    hidden: int
    dropout: float


def build(config: PriorConfig) -> SkeletonPrior:
    """Build a model by name.

    Raises
    ------
    ValueError
        If there is no such model.
    """
    if config.model not in FORMS:
        raise ValueError(f"model must be one of {', '.join(FORMS)}; got {config.model!r}")
    return FORMS[config.model](config)


def _kinematic(config: PriorConfig) -> SkeletonPrior:
    hidden = max(LEAST_HIDDEN, config.hidden // NARROWER)
    sizes: Sizes = {"hidden": hidden, "dropout": config.dropout}
    first, second = (KinematicCharacter(config.skeleton, config.limbs, **sizes) for _ in range(2))
    return SkeletonPrior(config, (first, second), both_roles=True)


def _paper(config: PriorConfig) -> SkeletonPrior:
    sizes: Sizes = {"hidden": config.hidden, "dropout": config.dropout}
    first, second = First(config.skeleton, **sizes), Second(config.skeleton, **sizes)
    return SkeletonPrior(config, (first, second), both_roles=False)


def _sized(kind: type[FrameCnn | FrameGcn | MotionCnn]) -> Callable[[PriorConfig], SkeletonPrior]:
    def built(config: PriorConfig) -> SkeletonPrior:
        first = kind(config.skeleton, hidden=config.hidden, first=True)
        second = kind(config.skeleton, hidden=config.hidden, first=False)
        return SkeletonPrior(config, (first, second), both_roles=False)

    return built


def _motion_gcn(config: PriorConfig) -> SkeletonPrior:
    sizes: Sizes = {"hidden": config.hidden, "dropout": config.dropout}
    first = MotionGcn(config.skeleton, **sizes, first=True)
    second = MotionGcn(config.skeleton, **sizes, first=False)
    return SkeletonPrior(config, (first, second), both_roles=False)


FORMS: dict[str, Callable[[PriorConfig], SkeletonPrior]] = {
    "kinematic": _kinematic,
    "paper": _paper,
    "f_cnn": _sized(FrameCnn),
    "f_gcn": _sized(FrameGcn),
    "m_cnn": _sized(MotionCnn),
    "m_gcn": _motion_gcn,
}
