"""The peer: UNO of neuraloperator, with our width, depth, grids, modes and skips."""

import contextlib
import importlib
import importlib.util
import sys
from itertools import pairwise

from torch import nn

from benchmarks._networks import WIDE
from pacmo_core.operators.uno import SKIPS, U_SHAPE_RATIOS, u_shape_channels

PEER = "neuralop"


def peer_operator(in_channels: int, out_channels: int) -> nn.Module | None:
    """Build the peer with its own initial weights; None, with a note, if it is not installed.

    It has no last skip from the lifted function to the head, no GELU after the sum of its
    branches, and works on the grid of the data without padding: all three make it cheaper.
    """
    if importlib.util.find_spec(PEER) is None:
        print("the peer is not installed: pip install 'neuraloperator==2.0.0'", file=sys.stderr)
        return None
    scalings = [after / before for before, after in pairwise((1.0, *U_SHAPE_RATIOS))]
    with contextlib.redirect_stdout(sys.stderr):  # its constructor prints
        network: nn.Module = importlib.import_module(f"{PEER}.models").UNO(
            in_channels=in_channels,
            out_channels=out_channels,
            hidden_channels=WIDE.width,
            lifting_channels=WIDE.width,
            projection_channels=4 * WIDE.width,
            n_layers=len(WIDE.modes),
            uno_out_channels=list(u_shape_channels(WIDE.width)),
            uno_n_modes=[[2 * modes - 2] for modes in WIDE.modes],  # it keeps half of them and one
            uno_scalings=[[scaling] for scaling in scalings],
            horizontal_skips_map=dict(SKIPS),
            channel_mlp_skip="linear",  # its default refuses layers that change width
        )
    return network
