"""Dependence of reactions on the frames at which the partner was sampled.

Usage: python -m benchmarks.invariance [--weights FILE] [--real FILE ...] [--json]

The same noise and the same partner are sampled in two ways; a mismatch is the relative L2 distance
of the reactions at common instants, metres in the partner's frame; ``..._varying`` is the same
distance relative to the variation of reactions about their mean, which a large distance between the
two people does not reduce.

Band-limited partners are the mean partner that the model was trained on, moved by a Gaussian field
of 16 modes on 1.25 of the model's usual duration: at most 12.8 cycles. 129 frames resolve 64.
``mismatch_2x``, ``_4x``, ``_jitter`` (by up to 40 % of a step), ``_dropped`` (30 % of frames) and
``_half`` (every second frame, 65) are against these.

Real partners are captures under PACMO_REAL_DATA in which the joints of a model can be named: SBU
at 15 frames a second, or salsa at 120. For each model of ``--real`` (or ``--weights``):
``SET_half``, ``_quarter`` and ``_dropped`` against all frames; ``_finer``, the spline through all
frames at 2 T - 1 jittered instants, against them; and ``SET_input_...``, how far the splines of
the two inputs differ themselves: noisy or few frames lack information of the others, so that
reactions that depend on the partner must differ too. ``mismatch_real`` is the worst of half and
dropped.
"""

from pathlib import Path

import numpy as np
import torch

from benchmarks._captures import captures_of
from benchmarks._figures import arguments, show
from benchmarks._sampling import jittered, mismatch, random_subset, smooth_partners
from pacmo_core.models import load_reaction_model
from pacmo_core.reaction.generator import Generator

WEIGHTS = Path("models/1/pacmo/1/weights.safetensors")
N_FRAMES = 129
N_PARTNERS = 8


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--real", type=Path, nargs="+", default=[], help="weights for captures")
    options = parser.parse_args()
    torch.set_num_threads(1)
    figures = band_limited(model_of(options.weights))
    for path in options.real or [options.weights]:
        figures |= captured(model_of(path))
    gated = ("_real_half", "_real_dropped")
    real = [value for name, value in figures.items() if name.endswith(gated)]
    show(figures | ({"mismatch_real": max(real)} if real else {}), as_json=options.json)


def model_of(path: Path) -> Generator:
    """Load a generator."""
    model = load_reaction_model(path)
    if not isinstance(model, Generator):
        raise TypeError(f"{path}: wanted a generator; got {type(model).__name__}")
    return model


def band_limited(model: Generator) -> dict[str, float]:
    """Compare samplings of functions that all of them resolve."""
    random = np.random.default_rng(0)
    times = np.linspace(0, 1, N_FRAMES)
    others = {
        "2x": np.linspace(0, 1, 2 * N_FRAMES - 1),
        "4x": np.linspace(0, 1, 4 * N_FRAMES - 3),
        "jitter": jittered(times, random),
        "dropped": times[random_subset(N_FRAMES, random)],
        "half": times[::2],
    }
    partners = smooth_partners(model, N_PARTNERS)
    base = [partner.at(times) for partner in partners]
    figures: dict[str, float] = {}
    for name, other in others.items():
        result = mismatch(model, base, [partner.at(other) for partner in partners])
        figures |= {f"mismatch_{name}": result.out, f"mismatch_{name}_varying": result.varying}
    return figures


def captured(model: Generator) -> dict[str, float]:
    """Compare thinned captures with whole ones."""
    random = np.random.default_rng(0)
    name, whole = captures_of(model)
    if not whole:
        return {}
    others = {
        "half": [c.only(np.arange(0, len(c.times), 2)) for c in whole],
        "quarter": [c.only(np.arange(0, len(c.times), 4)) for c in whole],
        "dropped": [c.only(random_subset(len(c.times), random)) for c in whole],
        "finer": [c.finer(random) for c in whole],
    }
    figures: dict[str, float] = {}
    for kind, other in others.items():
        result = mismatch(model, whole, other)
        figures |= {f"{name}_real_{kind}": result.out, f"{name}_input_{kind}": result.into}
        figures |= {f"{name}_real_{kind}_varying": result.varying}
    return figures


if __name__ == "__main__":
    main()
