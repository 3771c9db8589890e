"""DVC stages: their order, and which are stale and why.

DVC needs one to several seconds of processor time to find out which stages are stale, most of it
for its imports. The result is stored with a fingerprint of all that it depends on, so that an
unchanged workspace is recognised without DVC: path, inode, size and modification time of every
dependency, output and cached copy of an output, which is what DVC itself compares before it hashes
a file.
"""

import hashlib
import json
import logging
import os
import stat
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pacmo_core.project.workspace import (
    DVC_CACHE,
    DVC_LOCK,
    DVC_YAML,
    HISTORY,
    PARAMS,
    CommandError,
    log_event,
)
from pacmo_core.store.files import write_text

if TYPE_CHECKING:
    from dvc.output import Output
    from dvc.repo import Repo
    from dvc.stage import Stage

STATUS = HISTORY / "stages.json"
DAMAGED_LOCK = "dvc.lock.cut"
CONFIGURATION = (
    *(DVC_YAML, DVC_LOCK, PARAMS),
    *(Path(".dvcignore"), Path(".dvc/config"), Path(".dvc/config.local")),
)
Result = TypeVar("Result")


class TargetError(CommandError, ValueError):
    """A target that is not a stage."""


class UnreadableFileError(CommandError):
    """A dependency that has no content to hash."""


@dataclass(frozen=True)
class StageStatus:
    """The status of the stages as DVC reports it.

    Parameters
    ----------
    n_stages : number of stages
    reasons : by stale stage; stages that depend on a stale one are not listed
    """

    n_stages: int
    reasons: dict[str, list[str]]


def read_status() -> StageStatus:
    """Return the status of the stages, stored or from DVC; the same as ``dvc status``.

    DVC waits for its own lock: no run may write meanwhile.
    """
    return _stored_status() or readable_dvc_lock(_compute_status)


def readable_dvc_lock(read: Callable[[], Result]) -> Result:
    """Call a function that reads ``dvc.lock``; if it is incomplete, move it and call again.

    DVC refuses every command with an incomplete ``dvc.lock``, as a kill during its writing leaves.
    Without the file, its run cache restores the outputs, and the file is written again. The caller
    holds the writer lock, so that no other DVC is writing it.
    """
    from dvc.utils.strictyaml import YAMLSyntaxError, YAMLValidationError

    try:
        return read()
    except (YAMLSyntaxError, YAMLValidationError) as error:
        path = Path(error.path)
        if path.name != DVC_LOCK.name:
            raise
        path.replace(path.with_name(DAMAGED_LOCK))
        log_event(f"dvc.lock was incomplete; moved to {DAMAGED_LOCK}", logging.WARNING)
        return read()


def upstream_stages(targets: list[str]) -> dict[str, list[str]]:
    """List ``targets`` and the stages they depend on, in running order, each with its upstream.

    Parameters
    ----------
    targets : stages by address, such as ``react@pacmo-1-1``, or by name, such as ``react``; none
        means every stage

    Raises
    ------
    TargetError
        If a target is not a stage of ``dvc.yaml``.
    """
    with _repo() as repo:
        return _upstream(repo, targets)


def upstream_and_stale(targets: list[str]) -> tuple[dict[str, list[str]], set[str]]:
    """Return ``upstream_stages``, and all stale stages, from one reading of ``dvc.yaml``.

    Stale are the stages that DVC would run or restore, and all that depend on them.
    """
    with _repo() as repo:
        return _upstream(repo, targets), _stale(repo)


def stage_outputs() -> set[str]:
    """List the paths that stages write."""
    with _repo() as repo:
        return {out.def_path for out in repo.index.outs}


def has_remote() -> bool:
    """Return whether DVC has a remote to push to."""
    with _repo() as repo:
        return bool(repo.config["core"].get("remote"))


def is_target(stage: str, targets: list[str]) -> bool:
    """Return whether a stage is among targets, by address or by name."""
    return stage in targets or stage.partition("@")[0] in targets


def _repo() -> "Repo":
    from dvc.repo import Repo

    return Repo()


def _upstream(repo: "Repo", targets: list[str]) -> dict[str, list[str]]:
    import networkx as nx

    # DVC's own graph is not a documented interface: used in this module alone, and tested.
    graph = repo.index.graph
    selected = [s for s in graph if not targets or is_target(s.addressing, targets)]
    unknown = [t for t in targets if not any(is_target(s.addressing, [t]) for s in selected)]
    if unknown:
        known = ", ".join(sorted(stage.addressing for stage in graph))
        raise TargetError(f"{DVC_YAML} has no stage {', '.join(unknown)}; it has {known}")
    needed = set(selected).union(*(nx.descendants(graph, stage) for stage in selected))
    order = [s for s in reversed(list(nx.topological_sort(graph))) if s in needed and s.cmd]
    return {s.addressing: [u.addressing for u in graph[s] if u.cmd] for s in order}


def _stale(repo: "Repo") -> set[str]:
    import networkx as nx

    graph = repo.index.graph
    _fingerprint(Path(os.path.relpath(dep.fs_path)) for dep in repo.index.deps)
    changed = set(repo.status())
    stale = {stage for stage in graph if stage.addressing in changed}
    return {s.addressing for s in stale.union(*(nx.ancestors(graph, s) for s in stale))}


def _compute_status() -> StageStatus:
    with _repo() as repo:
        stages: list[Stage] = list(repo.index.stages)
        files = {item.fs_path for stage in stages for item in (*stage.deps, *stage.outs)}
        files |= {path for stage in stages for out in stage.outs for path in _objects(out)}
        paths = sorted({Path(os.path.relpath(file)) for file in files} | set(CONFIGURATION))
        before = _fingerprint(paths)
        changes = repo.status()
    status = StageStatus(
        len(stages), {name: list(_reasons(change)) for name, change in changes.items()}
    )
    # Store it only if nothing was written meanwhile.
    if _fingerprint(paths) == before:
        facts = {
            "fingerprint": before,
            "paths": [path.as_posix() for path in paths],
            "status": asdict(status),
        }
        write_text(STATUS, json.dumps(facts, indent=1) + "\n")
    return status


def _objects(out: "Output") -> Iterator[str]:
    """Yield the paths of an output in DVC's cache: one that is missing makes its stage stale."""
    from dvc_data.hashfile.tree import Tree

    if out.use_cache and out.hash_info:
        yield out.cache.oid_to_path(out.hash_info.value)
        content = out.get_obj()
        if isinstance(content, Tree):
            for _, _, hash_info in content:
                yield out.cache.oid_to_path(hash_info.value)


def _stored_status() -> StageStatus | None:
    try:
        facts = json.loads(STATUS.read_text(encoding="utf-8"))
        if _fingerprint(map(Path, facts["paths"])) == facts["fingerprint"]:
            return StageStatus(**facts["status"])
    except (OSError, ValueError, KeyError, TypeError):
        pass  # missing or incomplete: ask DVC
    return None


def _fingerprint(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    ignored = _ignored_names()
    for path in paths:
        for line in _file_facts(path, ignored):
            digest.update(f"{line}\n".encode())
    return digest.hexdigest()


def _file_facts(path: Path, ignored: frozenset[str]) -> Iterator[str]:
    try:
        facts = path.stat()
        entries = sorted(path.iterdir()) if stat.S_ISDIR(facts.st_mode) else None
    except FileNotFoundError:
        # A link into DVC's cache is one of its outputs, whose object is gone.
        if path.is_symlink() and not path.resolve().is_relative_to(DVC_CACHE.resolve()):
            raise UnreadableFileError(f"{path}: a link to nothing; remove it") from None
        yield f"{path} missing"
        return
    if entries is None and not stat.S_ISREG(facts.st_mode):
        # DVC would wait for ever for the content of a pipe.
        raise UnreadableFileError(f"{path}: neither a file nor a folder; remove it")
    if entries is None:
        yield f"{path} {facts.st_ino} {facts.st_size} {facts.st_mtime_ns}"
        return
    yield f"{path}/"
    for entry in entries:
        if entry.name not in ignored and entry.suffix not in ignored:
            yield from _file_facts(entry, ignored)


def _ignored_names() -> frozenset[str]:
    """Return the names of Python's bytecode files, if DVC ignores them too."""
    try:
        lines = Path(".dvcignore").read_text(encoding="utf-8").split()
    except FileNotFoundError:
        return frozenset()
    names = {"__pycache__/": "__pycache__", "*.pyc": ".pyc"}
    return frozenset(names[line] for line in lines if line in names)


def _reasons(changes: list[Any]) -> Iterator[str]:
    """Flatten the changes of a stage in ``dvc status``: ``changed deps: data/raw modified``."""
    for change in changes:
        if isinstance(change, str):
            yield change
            continue
        for kind, items in change.items():
            pairs = items.items() if isinstance(items, dict) else [(items, "")]
            yield f"{kind}: " + ", ".join(f"{name} {how}".strip() for name, how in pairs)
