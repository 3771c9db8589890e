"""Trusted as truth: the names and settings of the formats' own classes."""

import pytest

from pacmo_core.formats.ntu import Ntu
from pacmo_core.formats.registry import open_format

SETTINGS = {"fps": 30.0, "max_gap": 3, "max_link_distance": 0.3, "min_visible_share": 0.5}


def test_a_format_is_opened_by_name_and_refuses_what_it_does_not_know():
    assert open_format("ntu", SETTINGS) == Ntu(**SETTINGS)
    with pytest.raises(KeyError, match="there are ntu"):
        open_format("nto", {})
    with pytest.raises(ValueError, match="no setting rate; missing fps"):
        open_format("sbu", {"rate": 15})
    with pytest.raises(ValueError, match="fps must be"):
        open_format("ntu", SETTINGS | {"fps": 0})
