"""What is trusted: single precision on the CPU."""

from dataclasses import replace

import pytest
import torch

from pacmo_core.reaction import adversarial
from pacmo_core.reaction.adversaries import Adversaries
from pacmo_core.reaction.tensors import state
from tests.reaction.problems import PACMO, clips


def training(**changes: object) -> Adversaries:
    found = adversarial.fit(clips(8), replace(PACMO, **changes)).training
    assert isinstance(found, Adversaries)
    return found


def test_on_a_cpu_precision_and_compiling_change_no_bit() -> None:
    plain, asked = (
        adversarial.fit(clips(8), settings).finish()
        for settings in (PACMO, replace(PACMO, mixed_precision=True, compile_generator=True))
    )
    assert all(torch.equal(value, state(asked)[name]) for name, value in state(plain).items())


def test_reduced_precision_leaves_the_penalty_alone_and_hardly_moves_the_losses() -> None:
    parts = training()
    batch = parts._draw(mixed=True)
    whole, whole_terms = parts.objectives.of_critic(batch)
    # autocast works on a CPU too; the setting alone asks for a GPU.
    parts.objectives._reduced = True
    reduced, terms = parts.objectives.of_critic(batch)
    made, _ = parts.objectives.of_generator(parts._draw(mixed=False), judged=True)
    assert reduced.dtype == made.dtype == torch.float32
    assert parts.objectives.reactions(batch).dtype == torch.float32
    assert reduced.item() != whole.item()
    assert reduced.item() == pytest.approx(whole.item(), rel=1e-3)
    torch.testing.assert_close(terms["penalty"], whole_terms["penalty"], rtol=1e-3, atol=0)


def test_a_weight_on_constant_bones_is_a_term_and_moves_the_loss() -> None:
    plain, weighed = training(), training(bone_weight=3.0)
    (loss, _), (more, terms) = (
        parts.objectives.of_generator(parts._draw(mixed=False), judged=True)
        for parts in (plain, weighed)
    )
    assert more.item() == pytest.approx(loss.item() + 3 * terms["bones"].item(), rel=1e-5)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")
def test_a_gpu_trains_in_reduced_precision_with_a_compiled_generator() -> None:
    settings = replace(PACMO, mixed_precision=True, compile_generator=True)
    fit = adversarial.fit(clips(8), settings, validation=clips(3, first_seed=90), device="cuda")
    curve = list(fit)
    assert len(curve) == PACMO.n_epochs
    assert all(value.is_cuda for value in fit.model.state_dict().values())
