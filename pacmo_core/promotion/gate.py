"""May a newly trained model become current? Every reason against it, in words."""

from collections.abc import Mapping
from dataclasses import dataclass

from pacmo_core.figures.columns import CLOSER, HIGHER, LOWER, METRICS

Cell = Mapping[str, float]  # mean, low, high
Metrics = Mapping[str, Cell]


@dataclass(frozen=True, kw_only=True)
class Gate:
    """What a model must keep to.

    Parameters
    ----------
    row : the row of the table that is judged
    metrics : the metrics that may not become worse
    most_floors : F²ID may be at most so many times its floor, what two draws of real motion give
    """

    row: str
    metrics: tuple[str, ...]
    most_floors: float


def reasons_against(
    candidate: Mapping[str, Metrics], current: Mapping[str, Metrics] | None, gate: Gate
) -> list[str]:
    """Say why a model is not to become current; nothing if it may.

    A metric is worse by more than its interval where the candidate's mean lies beyond the bad end
    of the current model's interval. A metric that is better closer to real motion is held by its
    distance to the row ``real``, each in its own table.

    Parameters
    ----------
    candidate, current : tables of metrics by row; there is no current one on the first night

    Raises
    ------
    KeyError
        If the candidate's table lacks the row or one of the metrics.
    """
    found = _floor_reasons(candidate[gate.row], gate)
    if current is None:
        return found
    for name in gate.metrics:
        if name not in current.get(gate.row, {}):
            continue  # a metric that is new tonight has nothing to be worse than
        reason = _worse(name, candidate, current, gate.row)
        found += [reason] if reason else []
    return found


def _floor_reasons(metrics: Metrics, gate: Gate) -> list[str]:
    f2id, floor = metrics["f2id"]["mean"], metrics["f2id_floor"]["mean"]
    if f2id <= gate.most_floors * floor:
        return []
    return [
        f"F²ID {f2id:.4g} is above {gate.most_floors:g} times its floor {floor:.4g}, "
        f"that is {gate.most_floors * floor:.4g}"
    ]


def _worse(
    name: str, candidate: Mapping[str, Metrics], current: Mapping[str, Metrics], row: str
) -> str:
    new, old = candidate[row][name], current[row][name]
    better = METRICS[name].better
    label = METRICS[name].label
    if better == LOWER and new["mean"] > old["high"]:
        return f"{label} rose to {new['mean']:.4g}; current {_said(old)}"
    if better == HIGHER and new["mean"] < old["low"]:
        return f"{label} fell to {new['mean']:.4g}; current {_said(old)}"
    if better == CLOSER:
        goals = [table["real"][name]["mean"] for table in (candidate, current)]
        away, was_away = abs(new["mean"] - goals[0]), abs(old["mean"] - goals[1])
        # The interval's longer arm: its reach from the mean towards either side.
        reach = max(old["high"] - old["mean"], old["mean"] - old["low"])
        if away > was_away + reach:
            return f"{label} is {away:.4g} from real motion's; current {was_away:.4g} ± {reach:.4g}"
    return ""


def _said(cell: Cell) -> str:
    return f"{cell['mean']:.4g} ({cell['low']:.4g} to {cell['high']:.4g})"
