"""What is trusted: the text of the file."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from pacmo_core.formats.registry import DEFAULT_SETTINGS, open_format
from pacmo_core.models import MODELS
from stages.common.captures import open_captures
from stages.common.params import ParamsError, StageError, read_params
from stages.common.training import Task, train


@dataclass(frozen=True)
class Inner:
    rate: float


@dataclass(frozen=True)
class Section:
    width: int
    inner: Inner
    names: tuple[str, ...]


def refuse():
    raise ValueError("channels and modes must be at least 1;\n got 0")


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
        (GOOD.replace("stage", "other"), "stage: wanted a section of this name; there is none"),
        ("", "stage: wanted a section of this name"),
        ("stage: [", "params.yaml: not YAML: "),
    ],
)
def test_what_does_not_fit_is_named(tmp_path, text, said):
    with pytest.raises(StageError, match=said):
        read(tmp_path, text)


def test_a_wrong_value_is_said_with_the_file_of_the_experiment(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "experiments").mkdir()
    (tmp_path / "experiments" / "mine.yaml").write_text("experiment: mine\n")
    (tmp_path / "params.yaml").write_text("experiment: mine\n" + GOOD.replace("0.5", "fast"))
    with pytest.raises(ParamsError) as fault:
        read_params("stage", Section)
    assert str(fault.value).startswith("params.yaml (of experiments/mine.yaml), stage: inner.rate:")
    assert str(fault.value).endswith("got 'fast'")


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        ("bvhh", {}, r"ingest.format: no format 'bvhh'; there are ntu, "),
        ("sbu", {"rate": 1}, "ingest.settings: .*; no setting rate; missing fps"),
        ("sbu", {"fps": "fast"}, r"ingest.settings: fps: .*got 'fast'"),
        ("sbu", {"fps": 0}, r"ingest.settings: fps must be 0.1 to 10000; got 0"),
        ("sbu", {"fps": [30]}, r"ingest.settings: fps: .*got \[30\]"),
        ("table", {"up": "x"}, r"ingest.settings: up must be one of .*got 'x'"),
        ("cmu", {"fps": None}, r"ingest.settings: fps.*got None"),
    ],
)
def test_a_setting_of_a_format_that_cannot_be_is_said(name, settings, said):
    with pytest.raises(ParamsError, match=said):
        open_captures("ingest", name, settings)


def test_settings_are_read_as_the_format_wants_them():
    settings = {**DEFAULT_SETTINGS["bvh"], "unit": 1, "up": "z"}
    assert open_captures("ingest", "bvh", settings) == open_format("bvh", settings)
    for name in ("cmu", "duetdance", "expi", "interhuman", "ntu", "sbu", "table"):
        defaults = DEFAULT_SETTINGS[name]
        assert open_captures("ingest", name, defaults) == open_format(name, defaults)


@pytest.mark.parametrize(
    ("device", "build", "said"),
    [
        ("gpu", lambda _: None, "device must be auto, cpu or cuda; got 'gpu'"),
        ("cpu", lambda _: refuse(), "train_gru: no model can be made of the captures with this: "),
    ],
)
def test_settings_that_make_no_model_are_said(tmp_path, device, build, said):
    params = SimpleNamespace(device=device, threads=1, checkpoint_every=1)
    task = Task(MODELS["gru"], params, None, None, build)
    with pytest.raises(ParamsError, match=said):
        train(task, tmp_path / "model", tmp_path / "curve.csv")
