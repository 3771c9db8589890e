"""What is trusted: the tensors that went in."""

import pytest
import torch

from pacmo_core.store.files import StoreError
from pacmo_core.store.weights import read_weights, write_weights


def test_weights_and_configuration_come_back(tmp_path):
    state = {"a": torch.arange(6.0).reshape(2, 3).T, "b": torch.ones(1)}
    write_weights(tmp_path / "w.safetensors", {"width": 4}, state)
    config, read = read_weights(tmp_path / "w.safetensors")
    assert config == {"width": 4}
    assert all(torch.equal(read[name], state[name]) for name in state)


@pytest.mark.parametrize("content", [b"", b"\x80\x04pickle", b"\xff" * 64])
def test_what_is_not_safetensors_is_refused_by_name(tmp_path, content):
    (tmp_path / "w.safetensors").write_bytes(content)
    with pytest.raises(StoreError, match="not a complete file of weights"):
        read_weights(tmp_path / "w.safetensors")
