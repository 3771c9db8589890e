"""A skeleton as the graph that convolutions run on, and as the tree that places its joints."""

import numpy as np
import torch
from torch import Tensor

from pacmo_core.data.skeleton import Skeleton


def adjacency(skeleton: Skeleton) -> Tensor:
    """``(J, J)`` float32: ``A D⁻¹`` of the bones and of each joint with itself; columns sum to 1.

    Li et al. (2020), *Dynamic multiscale graph neural networks*, normalise so.
    """
    links = np.eye(len(skeleton.joints))
    parent, child = skeleton.bones.T
    links[parent, child] = links[child, parent] = 1
    return torch.tensor(links / links.sum(axis=0), dtype=torch.float32)


def neighbours(skeleton: Skeleton) -> Tensor:
    """``(J, J)`` float32: the part of ``adjacency`` off its diagonal: what comes along a bone."""
    links = adjacency(skeleton)
    return links - torch.diag(links.diagonal())


def paths(skeleton: Skeleton) -> Tensor:
    """``(J, J)`` float32: 1 where the bone into a column's joint leads to a row's joint.

    The root's own column is 1 throughout: with the root's place there and bone vectors elsewhere,
    one product of matrices places all joints.
    """
    between = np.zeros((len(skeleton.joints),) * 2)
    for joint in skeleton.order:
        parent = skeleton.parents[joint]
        if parent >= 0:
            between[joint] = between[parent]
        between[joint, joint] = 1
    return torch.tensor(between, dtype=torch.float32)


def parents_of(skeleton: Skeleton) -> Tensor:
    """``(J,)`` int64: each joint's parent, the root its own."""
    return torch.tensor([i if p < 0 else p for i, p in enumerate(skeleton.parents)])
