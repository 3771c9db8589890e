"""What DVC says: which stages there are, what each rests on, which are stale."""

import networkx as nx
from dvc.repo import Repo
from dvc.stage import Stage

from apps.failure import CommandError


class TargetError(CommandError, ValueError):
    """A target that is no stage."""


def survey(targets: list[str]) -> tuple[dict[str, list[str]], set[str]]:
    """Give ``stages_below`` and ``stale_stages`` from one look."""
    with Repo() as repo:
        return _below(repo, targets), _stale(repo)


def stages_below(targets: list[str]) -> dict[str, list[str]]:
    """List ``targets`` and all they rest on, in running order, each with its upstream.

    Parameters
    ----------
    targets : stages by address, such as ``react@pacmo`` or ``react``; none means every stage

    Raises
    ------
    TargetError
        If a target is no stage of ``dvc.yaml``.
    """
    with Repo() as repo:
        return _below(repo, targets)


def stale_stages() -> set[str]:
    """List the stages that DVC would run, or restore, if asked now.

    A stage below a stale one counts as stale: its input may change.
    """
    with Repo() as repo:
        return _stale(repo)


def _below(repo: Repo, targets: list[str]) -> dict[str, list[str]]:
    # DVC's own graph, not a documented interface: used here alone, and the tests would tell.
    graph = repo.index.graph
    tops = [stage for stage in graph if not targets or _is_named(stage, targets)]
    missing = [name for name in targets if not any(_is_named(top, [name]) for top in tops)]
    if missing:
        known = ", ".join(sorted(stage.addressing for stage in graph))
        raise TargetError(f"dvc.yaml has no stage {', '.join(missing)}; it has {known}")
    below = set(tops).union(*(nx.descendants(graph, top) for top in tops))
    order = [s for s in reversed(list(nx.topological_sort(graph))) if s in below and s.cmd]
    return {s.addressing: [u.addressing for u in graph[s] if u.cmd] for s in order}


def _stale(repo: Repo) -> set[str]:
    graph = repo.index.graph
    changed = set(repo.status())
    dirty = {stage for stage in graph if stage.addressing in changed}
    return {s.addressing for s in dirty.union(*(nx.ancestors(graph, s) for s in dirty))}


def _is_named(stage: Stage, names: list[str]) -> bool:
    return stage.addressing in names or stage.addressing.partition("@")[0] in names
