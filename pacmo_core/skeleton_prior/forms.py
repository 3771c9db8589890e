"""The models by name, as ``pacmo_core.models`` lists them: ours, the paper's, four baselines."""

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


def kinematic(config: PriorConfig) -> SkeletonPrior:
    """Build our model: limb inverse kinematics in the decoder."""
    hidden = max(LEAST_HIDDEN, config.hidden // NARROWER)
    sizes: Sizes = {"hidden": hidden, "dropout": config.dropout}
    first, second = (KinematicCharacter(config.skeleton, config.limbs, **sizes) for _ in range(2))
    return SkeletonPrior(config, (first, second), both_roles=True)


def paper(config: PriorConfig) -> SkeletonPrior:
    """Build the paper's model."""
    sizes: Sizes = {"hidden": config.hidden, "dropout": config.dropout}
    first, second = First(config.skeleton, **sizes), Second(config.skeleton, **sizes)
    return SkeletonPrior(config, (first, second), both_roles=False)


def _baseline(config: PriorConfig, kind: type[FrameCnn | FrameGcn | MotionCnn]) -> SkeletonPrior:
    first = kind(config.skeleton, hidden=config.hidden, first=True)
    second = kind(config.skeleton, hidden=config.hidden, first=False)
    return SkeletonPrior(config, (first, second), both_roles=False)


def f_cnn(config: PriorConfig) -> SkeletonPrior:
    """Build F-CNN."""
    return _baseline(config, FrameCnn)


def f_gcn(config: PriorConfig) -> SkeletonPrior:
    """Build F-GCN."""
    return _baseline(config, FrameGcn)


def m_cnn(config: PriorConfig) -> SkeletonPrior:
    """Build M-CNN."""
    return _baseline(config, MotionCnn)


def m_gcn(config: PriorConfig) -> SkeletonPrior:
    """Build M-GCN."""
    sizes: Sizes = {"hidden": config.hidden, "dropout": config.dropout}
    first = MotionGcn(config.skeleton, **sizes, first=True)
    second = MotionGcn(config.skeleton, **sizes, first=False)
    return SkeletonPrior(config, (first, second), both_roles=False)
