"""Truth: what npm/build.mjs makes of the packages that the lock names."""

from pathlib import Path

import pytest

from pacmo_core.figures.viewer import LIBRARY, read_asset
from tests.node import node


@pytest.mark.slow
def test_the_checked_in_library_is_what_the_build_makes(tmp_path: Path) -> None:
    node("build.mjs", tmp_path)
    assert (tmp_path / LIBRARY).read_text(encoding="utf-8") == read_asset(LIBRARY)
    assert (tmp_path / "three.LICENSE").read_text(encoding="utf-8") == read_asset("three.LICENSE")


def test_the_library_carries_its_licence_into_every_page() -> None:
    assert read_asset("three.LICENSE").strip() in read_asset(LIBRARY)


def test_the_library_cannot_end_its_script_early() -> None:
    assert "</script" not in read_asset(LIBRARY).lower()
    assert "<!--" not in read_asset(LIBRARY)
