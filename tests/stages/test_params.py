"""What is trusted: the text of the file."""

from dataclasses import dataclass

import pytest

from stages.common.params import ParamsError, read_params


@dataclass(frozen=True)
class Inner:
    rate: float


@dataclass(frozen=True)
class Section:
    width: int
    inner: Inner
    names: tuple[str, ...]


GOOD = "stage: {width: 4, inner: {rate: 0.5}, names: [a, b]}\n"


def read(tmp_path, text):
    (tmp_path / "params.yaml").write_text(text)
    return read_params("stage", Section, tmp_path / "params.yaml")


def test_a_section_becomes_its_dataclass(tmp_path):
    assert read(tmp_path, GOOD) == Section(4, Inner(0.5), ("a", "b"))


def test_what_the_command_line_gives_completes_the_section_and_never_overrides_it(tmp_path):
    text = GOOD.replace("width: 4, ", "")
    (tmp_path / "params.yaml").write_text(text)
    path = tmp_path / "params.yaml"
    assert read_params("stage", Section, path, given={"width": 7}).width == 7
    path.write_text(GOOD)
    with pytest.raises(ParamsError, match="stage: width comes from the command line"):
        read_params("stage", Section, path, given={"width": 7})


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GOOD.replace("width", "wdth"), "unknown wdth"),
        (GOOD.replace("rate", "rat"), "unknown inner.rat"),
        (GOOD.replace("width: 4, ", ""), "width: Field required"),
        (GOOD.replace("width: 4", "width: wide"), "width: Input should be a valid integer"),
        (GOOD.replace("stage", "other"), "no section stage"),
        ("", "no section stage"),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, text, said):
    with pytest.raises(ParamsError, match=said):
        read(tmp_path, text)
