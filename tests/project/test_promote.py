"""What is trusted: the weights' bytes that the test wrote."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pacmo_core import promotion
from pacmo_core.commands.cli import app
from pacmo_core.project.lock import writer_lock
from pacmo_core.project.promote import decide_promotion, read_candidate, repair_promotion, roll_back
from pacmo_core.project.workspace import (
    DECISIONS,
    HISTORY_PAGE,
    LOCK,
    PROMOTED_MODELS,
    CommandError,
)
from pacmo_core.promotion import Gate, read_decisions

GATE = Gate(row="pacmo", metrics=("f2id",), max_noise_floor_ratio=2.0)
WEIGHTS = Path("models/1/pacmo/1/weights.safetensors")
CURRENT = PROMOTED_MODELS / "current" / WEIGHTS


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").touch()


def train(weights: bytes, f2id: float, experiment="lab"):
    """Leave what a reproduction would: weights and metrics."""
    WEIGHTS.parent.mkdir(parents=True, exist_ok=True)
    WEIGHTS.write_bytes(weights)
    Path("reports").mkdir(exist_ok=True)
    cells = {"f2id": f2id, "f2id_floor": 0.5}
    row = {name: {"mean": x, "low": x - 0.1, "high": x + 0.1} for name, x in cells.items()}
    facts = {"experiment": experiment, "pacmo": {"rows": {"pacmo": row, "real": {}}}}
    Path("reports/details.json").write_text(json.dumps(facts))
    Path("reports/metrics.json").write_text("{}")
    Path("reports/pacmo.json").write_text(json.dumps({"test_reactions": 12}))


def test_a_good_model_becomes_current_with_its_metrics_and_a_worse_one_does_not():
    train(b"one", 0.5)
    assert decide_promotion(GATE).verdict == "promoted"
    train(b"two", 0.7)
    held = decide_promotion(GATE)
    assert (held.verdict, held.current_model, held.test_reactions) == ("rejected", 1, 12)
    assert held.reasons == ("F²ID rose to 0.7; current 0.5 (0.4 to 0.6)",)
    assert CURRENT.read_bytes() == b"one"
    assert (
        json.loads((PROMOTED_MODELS / "current/reports/details.json").read_text())["experiment"]
        == "lab"
    )


def test_the_same_weights_are_no_new_decision_to_make():
    train(b"one", 0.5)
    decide_promotion(GATE)
    again = decide_promotion(GATE)
    assert (again.verdict, again.number, again.current_model) == ("unchanged", 2, 1)


def test_a_rollback_brings_the_weights_back_and_what_was_withdrawn_stays_out():
    for weights, f2id in ((b"one", 0.5), (b"two", 0.4)):
        train(weights, f2id)
        decide_promotion(GATE)
    back = roll_back("it slides")
    assert (back.verdict, back.reasons) == ("rolled back", ("from 2 to 1: it slides",))
    assert CURRENT.read_bytes() == b"one"
    held = decide_promotion(GATE)
    assert held.verdict == "rejected" and "were rolled back on" in held.reasons[0]
    train(b"three", 0.45)
    assert decide_promotion(GATE).verdict == "promoted"
    assert roll_back("again").current_model == 1  # not to the one withdrawn before


def test_there_must_be_one_to_go_back_to():
    with pytest.raises(CommandError, match="no model was promoted before the current one, 0"):
        roll_back("why not")
    train(b"one", 0.5)
    decide_promotion(GATE)
    with pytest.raises(CommandError, match="before the current one, 1"):
        roll_back("why not")


def test_another_experiments_metrics_are_not_compared():
    train(b"one", 0.1)
    decide_promotion(GATE)
    train(b"two", 0.9, experiment="other")
    assert decide_promotion(GATE).verdict == "promoted"


def test_a_kill_between_decision_and_link_is_made_good():
    for weights, f2id in ((b"one", 0.5), (b"two", 0.4)):
        train(weights, f2id)
        decide_promotion(GATE)
    promotion.set_current_model(PROMOTED_MODELS, 1)
    repair_promotion()
    assert CURRENT.read_bytes() == b"two"


def test_a_kill_before_the_decision_leaves_no_model_and_costs_no_number():
    train(b"one", 0.5)
    promotion.prepare_model(PROMOTED_MODELS, 1, read_candidate("pacmo").files)
    repair_promotion()
    assert list(PROMOTED_MODELS.iterdir()) == []
    promotion.prepare_model(PROMOTED_MODELS, 7, read_candidate("pacmo").files)
    found = decide_promotion(GATE)
    assert (found.verdict, found.number) == ("promoted", 1)
    assert sorted(path.name for path in PROMOTED_MODELS.iterdir()) == ["000001", "current"]
    assert CURRENT.read_bytes() == b"one"


def test_a_kill_between_the_decision_and_its_model_is_made_good():
    train(b"one", 0.5)
    decide_promotion(GATE)
    (PROMOTED_MODELS / "current").unlink()
    (PROMOTED_MODELS / "000001").rename(PROMOTED_MODELS / ".000001")
    repair_promotion()
    assert CURRENT.read_bytes() == b"one"


def test_a_decision_that_cannot_be_written_leaves_no_model(monkeypatch):
    train(b"one", 0.5)

    def full(*_):
        raise OSError(28, "No space left on device", "d")

    with monkeypatch.context() as patch, pytest.raises(OSError, match="No space"):
        patch.setattr("pacmo_core.project.promote.add_decision", full)
        decide_promotion(GATE)
    assert promotion.list_models(PROMOTED_MODELS) == []
    assert decide_promotion(GATE).number == 1
    assert sorted(path.name for path in PROMOTED_MODELS.iterdir()) == ["000001", "current"]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("metric", ["f2id", "f2id_floor"])
@pytest.mark.parametrize("part", ["mean", "low", "high"])
def test_a_metric_that_is_not_finite_holds_the_model_and_leaves_nothing_on_the_shelf(
    value, metric, part
):
    train(b"one", 0.5)
    details = json.loads(Path("reports/details.json").read_text())
    details["pacmo"]["rows"]["pacmo"][metric][part] = value
    Path("reports/details.json").write_text(json.dumps(details))
    for _ in range(2):
        held = decide_promotion(GATE)
        assert held.verdict == "rejected" and metric not in held.metrics
        assert "of pacmo is no finite interval" in held.reasons[0]
    assert not PROMOTED_MODELS.exists() or list(PROMOTED_MODELS.iterdir()) == []


METRIC = {"mean": 0.5, "low": 0.4, "high": 0.6}
NO_INTERVALS = [
    *({**METRIC, "mean": value} for value in ("0.1", None, True, [0.1], 10**400)),
    *({"mean": 0.5, "low": 0.4}, [0.1, 0.0, 0.2], 0.1, None, "x"),
]


@pytest.mark.parametrize("interval", NO_INTERVALS, ids=str)
def test_a_metric_that_is_no_interval_of_numbers_holds_the_model(interval):
    train(b"one", 0.5)
    details = json.loads(Path("reports/details.json").read_text())
    details["pacmo"]["rows"]["pacmo"]["f2id"] = interval
    Path("reports/details.json").write_text(json.dumps(details))
    held = decide_promotion(GATE)
    assert held.verdict == "rejected" and "F²ID of pacmo is" in held.reasons[0]
    assert promotion.list_models(PROMOTED_MODELS) == []


def test_a_noise_floor_that_overflows_promotes_nothing():
    train(b"one", 0.5)
    details = json.loads(Path("reports/details.json").read_text())
    details["pacmo"]["rows"]["pacmo"]["f2id_floor"] = dict.fromkeys(METRIC, 1e308)
    Path("reports/details.json").write_text(json.dumps(details))
    assert decide_promotion(GATE).verdict == "rejected"


DAMAGED = ["{", "[]", "", "null", '{"experiment": "lab"}', '{"pacmo": {"rows": []}}', "[" * 9999]


@pytest.mark.parametrize("text", [*DAMAGED, '{"experiment": 1, "pacmo": {"rows": {}}}'])
@pytest.mark.parametrize("whose", ["reports", "promoted/current/reports"])
def test_a_table_of_metrics_that_is_damaged_is_named_in_one_line(text, whose):
    train(b"one", 0.5)
    decide_promotion(GATE)
    train(b"two", 0.4)
    (Path(whose) / "details.json").write_text(text)
    with pytest.raises(CommandError, match=f"^{whose}/details.json: .+$"):
        decide_promotion(GATE)
    assert promotion.list_models(PROMOTED_MODELS) == [1]


@pytest.mark.parametrize("count", ["NaN", "-5", '"12"', "1e3", "null"])
def test_a_number_of_reactions_that_is_none_is_named(count):
    train(b"one", 0.5)
    Path("reports/pacmo.json").write_text(f'{{"test_reactions": {count}}}')
    with pytest.raises(CommandError, match="pacmo.json: wanted a number of test_reactions"):
        decide_promotion(GATE)


WRONG = {
    "number": 3,
    "verdict": "maybe",
    "reasons": [1],
    "at": None,
    "model": 5,
    "current_model": 2,
    "experiment": ["lab"],
    "test_reactions": "many",
    "metrics": {"f2id": {"mean": "low"}},
}
ODD = [
    *({"reasons": "text"}, {"reasons": {"a": 1}}, {"reasons": ["\x1b[2J"]}, {"model": "\ud800"}),
    *({"test_reactions": 10**30}, {"metrics": {"f2id": {**METRIC, "high": 10**400}}}),
]


@pytest.mark.parametrize("change", [*({name: WRONG[name]} for name in WRONG), *ODD], ids=str)
def test_a_decision_that_parses_and_is_wrong_is_set_aside(change):
    train(b"one", 0.5)
    decide_promotion(GATE)
    file = DECISIONS / "000001.json"
    wrong = {
        **json.loads(file.read_text()),
        "number": 2,
        "verdict": "unchanged",
        **change,
    }
    (DECISIONS / "000002.json").write_text(json.dumps(wrong))
    repair_promotion()
    assert (DECISIONS / "000002.broken").exists()
    assert [d.number for d in read_decisions(DECISIONS)[0]] == [1]
    train(b"two", 0.4)
    assert decide_promotion(GATE).number == 3
    assert CURRENT.read_bytes() == b"two"


def test_a_broken_decision_is_put_aside_and_the_rest_stands():
    train(b"one", 0.5)
    decide_promotion(GATE)
    (DECISIONS / "000007.json").write_text("{")
    repair_promotion()
    assert (DECISIONS / "000007.broken").exists()
    assert len(read_decisions(DECISIONS)[0]) == 1


def test_the_page_shows_every_decision_with_its_reasons():
    train(b"one", 0.5)
    decide_promotion(GATE)
    train(b"<two>", 0.7)
    decide_promotion(GATE)
    page = HISTORY_PAGE.read_text()
    assert page.count("<svg") == 2
    assert "promoted" in page and "rose to 0.7" in page


def test_without_a_reproduction_there_is_nothing_to_judge():
    with pytest.raises(CommandError, match="run ./run first"):
        read_candidate("pacmo")


def test_the_command_rolls_back_and_status_tells_of_it():
    for weights, f2id in ((b"one", 0.5), (b"two", 0.4)):
        train(weights, f2id)
        decide_promotion(GATE)
    done = CliRunner().invoke(app, ["rollback", "--why", "it slides"])
    assert (done.exit_code, done.output[:24]) == (0, "current is promoted/0000"), done.output
    facts = json.loads(CliRunner().invoke(app, ["status", "--json", "--no-stale"]).output)
    assert facts["current"] == 1
    assert facts["runs"][-1]["reason"] == "from 2 to 1: it slides"
    refused = CliRunner().invoke(app, ["rollback", "--why", "more"])
    assert refused.exit_code == 1
    assert CliRunner().invoke(app, ["status", "--check", "--no-stale"]).exit_code == 1


def test_status_says_who_writes_and_asks_dvc_nothing_meanwhile():
    with writer_lock("nightly", LOCK):
        shown = CliRunner().invoke(app, ["status"]).output
    assert "writing now   nightly since" in shown and "known after its end" in shown
