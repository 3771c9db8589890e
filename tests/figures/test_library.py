"""Truth: what npm/build.mjs makes of the packages that the lock names."""

from pathlib import Path

import pytest

from pacmo_core.figures.viewer import LIBRARY, part
from tests.node import node


@pytest.mark.slow
def test_the_checked_in_library_is_what_the_build_makes(tmp_path: Path) -> None:
    node("build.mjs", tmp_path)
    assert (tmp_path / LIBRARY).read_text(encoding="utf-8") == part(LIBRARY)
    assert (tmp_path / "three.LICENSE").read_text(encoding="utf-8") == part("three.LICENSE")


def test_the_library_carries_its_licence_into_every_page() -> None:
    assert part("three.LICENSE").strip() in part(LIBRARY)


def test_the_library_cannot_end_its_script_early() -> None:
    assert "</script" not in part(LIBRARY).lower()
    assert "<!--" not in part(LIBRARY)
