"""What DVC says: which stages there are, what each rests on, which are stale."""

import networkx as nx
from dvc.repo import Repo
from dvc.stage import Stage


def stages_below(targets: list[str]) -> dict[str, list[str]]:
    """List ``targets`` and all they rest on, in running order, each with its upstream.

    Parameters
    ----------
    targets : stages by address, such as ``react@pacmo`` or ``react``; none means every stage

    Raises
    ------
    ValueError
        If a target is no stage of ``dvc.yaml``.
    """
    with Repo() as repo:
        # DVC's own graph, not a documented interface: used here alone, and the tests would tell.
        graph = repo.index.graph
        tops = [stage for stage in graph if not targets or _is_named(stage, targets)]
        missing = [name for name in targets if not any(_is_named(top, [name]) for top in tops)]
        if missing:
            known = ", ".join(sorted(stage.addressing for stage in graph))
            raise ValueError(f"dvc.yaml has no stage {', '.join(missing)}; it has {known}")
        below = set(tops).union(*(nx.descendants(graph, top) for top in tops))
        order = [s for s in reversed(list(nx.topological_sort(graph))) if s in below and s.cmd]
        return {s.addressing: [u.addressing for u in graph[s] if u.cmd] for s in order}


def stale_stages() -> set[str]:
    """List the stages that DVC would run, or restore, if asked now.

    A stage below a stale one counts as stale: its input may change.
    """
    with Repo() as repo:
        graph = repo.index.graph
        changed = set(repo.status())
        dirty = {stage for stage in graph if stage.addressing in changed}
        return {s.addressing for s in dirty.union(*(nx.ancestors(graph, s) for s in dirty))}


def _is_named(stage: Stage, names: list[str]) -> bool:
    return stage.addressing in names or stage.addressing.partition("@")[0] in names
