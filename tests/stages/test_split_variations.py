"""Truth: solutions of one pair of bodies share a split, and leave that of the first as it was."""

import numpy as np
import pytest

from pacmo_core.data.variation_splits import VariationScales
from stages.split_variations import Params, assign

PARAMS = Params(
    held_out=("clip3",), n_folds=5, folds=(), test_share=0.3, validation_share=0.2, random_seed=7
)
N_BONES, N_BODIES = 4, 6


def variations(n_solutions: int) -> dict[str, VariationScales]:
    random = np.random.default_rng(0)
    facts = {}
    for clip in range(5):
        for body in range(N_BODIES):
            scales = np.exp(0.1 * random.standard_normal((2, N_BONES)))
            for number in range(n_solutions):
                end = f"-{number}" if number else ""
                facts[f"clip{clip}~r{body}{end}"] = VariationScales(f"clip{clip}", scales)
    return facts


@pytest.mark.parametrize("name", ["random", "cross_interaction", "random_9"])
def test_all_solutions_of_a_pair_of_bodies_are_in_its_split(name: str) -> None:
    one, three = (assign(variations(n), name, PARAMS) for n in (1, 3))
    assert set(one.values()) > {"train", "test"}
    assert len(three) == 3 * len(one)
    for variation, split in one.items():
        assert [three[variation + end] for end in ("", "-1", "-2")] == [split] * 3
