"""What is trusted: changes that add up by construction, and the rows themselves."""

import numpy as np
import pytest
import torch

from pacmo_core.skeleton_prior.blending import Blend, blended
from pacmo_core.skeleton_prior.examples import encode
from tests.skeleton_prior.bodies import examples, generator


def test_a_blend_of_answers_that_are_linear_is_the_answer_to_the_blended_body():
    random = generator()
    template = torch.randn(5, 2, 4, 3, generator=random, dtype=torch.float64)
    answer = torch.randn(8, 5, 2, 4, 3, generator=random, dtype=torch.float64)
    scales = 1 + 0.2 * torch.rand(3, 2, 4, generator=random, dtype=torch.float64) - 0.1
    varied = template + torch.tensordot((scales - 1).flatten(1), answer, dims=1)
    weights = torch.tensor([0.9, 0.3, 0.8], dtype=torch.float64)
    motion, body = blended(template, varied, scales, weights)
    wanted = template + torch.tensordot((body - 1).flatten(), answer, dims=1)
    torch.testing.assert_close(motion, wanted)
    assert (body - 1).abs().max() <= (scales - 1).abs().max() + 1e-12


def test_a_blend_of_one_with_weight_one_is_itself():
    template = torch.randn(5, 2, 4, 3, generator=generator())
    varied, scales = template[None] + 0.1, torch.full((1, 2, 4), 1.2)
    motion, body = blended(template, varied, scales, torch.ones(1))
    torch.testing.assert_close(motion, varied[0])
    torch.testing.assert_close(body, scales[0])


def test_bodies_that_do_not_change_blend_into_themselves():
    template, ones = torch.randn(5, 2, 4, 3, generator=generator()), torch.ones(2, 2, 4)
    motion, body = blended(template, template.expand(2, 5, 2, 4, 3), ones, torch.rand(2))
    assert torch.equal(motion, template)
    assert torch.equal(body, ones[0])


def test_blends_are_of_one_source_and_as_many_and_as_frequent_as_asked():
    sources, random = torch.tensor([0, 1, 0, 1, 1, 0]), generator()
    drawn = [Blend(share=0.4, most=3).draw(1, sources, random) for _ in range(2000)]
    mixed = [chosen for chosen, _ in drawn if len(chosen) > 1]
    assert abs(len(mixed) / len(drawn) - 0.4) < 0.03
    assert {len(chosen) for chosen in mixed} == {2, 3, 4}
    assert all(int(chosen[0]) == 1 and (sources[chosen] == 1).all() for chosen, _ in drawn)
    assert all(float(weights.min()) > 0 for _, weights in drawn if len(weights) == 1)


def test_without_blends_windows_are_the_rows_and_with_them_are_not():
    encoded = encode(examples(1, 4))
    rows = torch.arange(len(encoded))
    pure, mixed = (
        encoded.windows(rows, 2, 5, Blend(share=share, most=2), generator(3))
        for share in (0.0, 1.0)
    )
    np.testing.assert_array_equal(pure.scales, encoded.scales)
    assert not torch.equal(mixed.scales, encoded.scales)
    assert mixed.varied.shape == mixed.template.shape == pure.varied.shape


@pytest.mark.parametrize(("share", "most"), [(-0.1, 1), (1.1, 1), (0.5, 0)])
def test_a_blend_of_impossible_numbers_is_refused(share, most):
    with pytest.raises(ValueError, match="share must lie in"):
        Blend(share=share, most=most)
