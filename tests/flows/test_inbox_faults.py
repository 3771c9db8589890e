"""What is trusted: the names and files that the test made; what lies where afterwards."""

import errno
import json
import os
import shutil
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from flows import inbox
from flows.inbox import MAX_FOLDER, IntakeResult, shorten_name, take_captures
from pacmo_core.data.skeleton import NTU25
from pacmo_core.project.lock import remove_partial_files
from pacmo_core.project.stages import read_status, upstream_and_stale
from pacmo_core.project.status import project_status, status_lines
from pacmo_core.project.workspace import INTAKE_PLAN, CommandError, configure_logging
from pacmo_core.store.motions import write_motions
from pacmo_core.store.tables import ClipRecord, QuarantineRecord, write_rows
from tests.flows.projects import capture, make_project

NAME = "skeleton_pos.txt"
RAW = Path("data/captures/lab")
INBOX = Path("data/inbox")


@pytest.fixture(scope="module")
def template(tmp_path_factory):
    """Make the project once: DVC takes seconds for it."""
    folder = tmp_path_factory.mktemp("template")
    make_project(folder)
    return folder


@pytest.fixture(autouse=True)
def project(template, tmp_path, monkeypatch):
    shutil.copytree(template, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    configure_logging()


def put(path: str | bytes, seed: int = 0) -> Path:
    """Put a usable capture into a folder of the inbox."""
    folder = INBOX / os.fsdecode(path)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / NAME).write_text(capture(seed))
    return folder / NAME


def night(good: str = "good") -> IntakeResult:
    """Take captures in, with one good capture beside those of the test."""
    put(good, seed=99)
    result = take_captures(settle_s=0.0)
    assert good in result.accepted and (RAW / good / NAME).is_file()
    again = take_captures(settle_s=0.0)  # no later night is stopped
    assert again.accepted == () and again.quarantined == {}
    return result


def reasons() -> list[dict]:
    return [json.loads(p.read_text()) for p in sorted(Path("data/quarantine").glob("*/*.json"))]


def irregular(make: Callable[[Path], None]) -> Path:
    folder = INBOX / "odd"
    folder.mkdir(parents=True)
    make(folder / NAME)
    return folder / NAME


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as opened:
        opened.bind(os.path.relpath(path))


IRREGULAR = {
    "a pipe": os.mkfifo,
    "a socket": _socket,
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "a link to nothing, as it loops": lambda path: path.symlink_to(path.name),
    "a link out of the folder": lambda path: path.symlink_to(Path("outside.txt").resolve()),
    "a link out of the folder, to a device": lambda path: path.symlink_to("/dev/zero"),
    "a folder": lambda path: path.symlink_to(".", target_is_directory=True),
}


@pytest.mark.parametrize("kind", IRREGULAR)
def test_what_is_no_regular_file_is_quarantined_unopened(kind):
    Path("outside.txt").write_text(capture(5))
    odd = irregular(IRREGULAR[kind])
    result = night()
    assert kind.partition(",")[0] in result.quarantined["odd"]
    assert not os.path.lexists(odd)
    (facts,) = reasons()
    assert facts["files"] == [f"odd/{NAME}"] and facts["reason"] == result.quarantined["odd"]
    assert Path("outside.txt").read_text() == capture(5)


def test_a_link_within_the_inbox_is_taken_as_its_content():
    first = put("one", 1)
    (INBOX / "two").mkdir()
    (INBOX / "two" / NAME).symlink_to(Path("..") / "one" / NAME)
    result = night()
    assert "one" in result.accepted
    assert result.quarantined == {"two": "the same content as one"}
    assert not first.exists() and (RAW / "one" / NAME).is_file()


@pytest.mark.parametrize("length", [140, 250])
def test_a_long_name_stops_no_night(length):
    put("n" * length)
    result = night()
    assert (length == 140) == ("n" * length in result.accepted)
    if length > 140:
        assert "250 characters" in result.quarantined["n" * length]
        (kept,) = Path("data/quarantine").rglob(NAME)
        assert kept.read_text() == capture(0)


def test_long_names_that_begin_alike_are_quarantined_apart():
    put("n" * 250 + "a", 1)
    put("n" * 250 + "b", 2)
    assert len(night().quarantined) == len(reasons()) == 2
    assert len(list(Path("data/quarantine").rglob(NAME))) == 2


CJK = "動作" * 40  # 80 characters of three bytes: a name of 240


@pytest.mark.parametrize("path", [CJK, f"{CJK}/{CJK}"])
def test_a_long_name_of_wide_characters_is_quarantined_with_its_reason(path):
    put(path).write_text("1,2")
    (reason,) = night().quarantined.values()
    assert [facts["reason"] for facts in reasons()] == [reason]
    (kept,) = Path("data/quarantine").rglob(NAME)
    assert kept.read_text() == "1,2"


def test_a_plan_with_a_folder_of_too_many_bytes_is_carried_out_under_short_names():
    put("odd").write_text("1,2")
    move = {"name": f"{CJK}/{CJK}", "files": [f"odd/{NAME}"], "reason": "short", "line": 0}
    INTAKE_PLAN.parent.mkdir(exist_ok=True)
    INTAKE_PLAN.write_text(json.dumps([{**move, "to": f"data/quarantine/{CJK}.20261124T0000000"}]))
    night()
    assert [facts["reason"] for facts in reasons()] == ["short"]
    (kept,) = Path("data/quarantine").rglob("file-0")
    assert kept.read_text() == "1,2" and len(kept.parent.name.encode()) < 255


@example(CJK, "a", "b")
@example("n" * 200, "a", "b")
@given(st.text(min_size=1, max_size=200), st.text(max_size=100), st.text(max_size=100))
def test_a_shortened_name_is_a_start_of_whole_characters_and_distinct(start, one, other):
    names = [shorten_name(start + end, MAX_FOLDER) for end in (one, other)]
    for name, end in zip(names, (one, other), strict=True):
        assert len(name.encode()) <= MAX_FOLDER
        assert (start + end).startswith(name if name == start + end else name[:-9])
    assert (names[0] == names[1]) == (one == other)


@pytest.mark.parametrize("is_usable", [True, False])
def test_what_the_system_refuses_is_set_aside_under_short_names(monkeypatch, is_usable):
    copied = shutil.copyfile

    def refuse(source, target):
        if "odd" in Path(target).parts:
            raise OSError(errno.ENAMETOOLONG, "File name too long", str(target))
        return copied(source, target)

    monkeypatch.setattr(inbox.shutil, "copyfile", refuse)
    content = capture(1) if is_usable else "1,2"
    put("odd").write_text(content)
    (INBOX / "odd").rename(INBOX / "set")
    put("set/odd").write_text(content)
    (INBOX / "set" / NAME).unlink()
    result = night()
    (reason,) = result.quarantined.values()
    assert ("File name too long" in reason) == is_usable
    (facts,) = reasons()
    assert facts["reason"] == reason and facts["files"] == [f"set/odd/{NAME}"]
    (kept,) = Path("data/quarantine").rglob("file-0")
    assert kept.read_text() == content and not list(RAW.rglob("odd/*"))


def test_an_error_of_the_machine_ends_the_night_and_the_next_one_continues(monkeypatch):
    def fail(source, target):
        raise OSError(errno.ENOSPC, "No space left on device", str(target))

    put("a", 1)
    with monkeypatch.context() as patch:
        patch.setattr(inbox.shutil, "copyfile", fail)
        for _ in range(2):
            with pytest.raises(OSError, match="No space left"):
                take_captures(settle_s=0.0)
    assert reasons() == []
    night()
    assert (RAW / "a" / NAME).read_text() == capture(1)


def _gone_before_the_copy(monkeypatch, file):
    copied = shutil.copyfile

    def remove_first(source, target):
        if source == file:
            file.unlink()
        return copied(source, target)

    monkeypatch.setattr(inbox.shutil, "copyfile", remove_first)


def _gone_before_the_plan(monkeypatch, file):
    planned = inbox.move_captures

    def remove_first(*arguments):
        file.unlink(missing_ok=True)
        return planned(*arguments)

    monkeypatch.setattr(inbox, "move_captures", remove_first)


def _gone_before_the_reading(monkeypatch, file):
    read = inbox.read_sequences

    def remove_first(*arguments):
        file.unlink(missing_ok=True)
        return read(*arguments)

    monkeypatch.setattr(inbox, "read_sequences", remove_first)


def _gone_after_the_reading(monkeypatch, file):
    read = inbox.read_sequences

    def remove_after(*arguments):
        outcomes = list(read(*arguments))
        file.unlink(missing_ok=True)
        return outcomes

    (RAW / "gone").mkdir()
    (RAW / "gone" / NAME).write_text(capture(1))
    monkeypatch.setattr(inbox, "read_sequences", remove_after)


def _gone_before_it_is_settled(monkeypatch, file):
    walked = inbox.walk_files

    def remove_after(*arguments):
        files = list(walked(*arguments))
        file.unlink(missing_ok=True)
        return files

    monkeypatch.setattr(inbox, "walk_files", remove_after)


@pytest.mark.parametrize(
    "remove",
    [
        _gone_before_it_is_settled,
        _gone_before_the_reading,
        _gone_after_the_reading,
        _gone_before_the_plan,
        _gone_before_the_copy,
    ],
)
def test_a_file_that_disappears_stops_no_night(remove, monkeypatch):
    remove(monkeypatch, put("gone", 1))
    result = night()
    assert result.gone == (() if remove is _gone_before_it_is_settled else ("gone",))
    assert result.quarantined == {} and reasons() == []
    assert (RAW / "gone").exists() == (remove is _gone_after_the_reading)


def test_a_path_that_is_too_long_is_quarantined_with_its_content():
    put("/".join(["p" * 200] * 8))
    (reason,) = night().quarantined.values()
    assert "wanted at most 1000" in reason
    (kept,) = Path("data/quarantine").rglob("file-0")
    assert kept.read_text() == capture(0)


@pytest.mark.parametrize(("name", "depth"), [("d", 1600), ("p" * 240, 20)])
def test_folders_too_deep_for_a_path_or_for_python_stop_no_night(tmp_path, name, depth):
    INBOX.mkdir(parents=True, exist_ok=True)
    os.chdir(INBOX)
    for _ in range(depth):
        Path(name).mkdir()
        os.chdir(name)
    Path(NAME).write_text(capture(1))
    os.chdir(tmp_path)
    try:
        (left,) = night().waiting
        assert left.startswith(f"{name}/{name}/")
        assert project_status(stale=True)["inbox"] == []
        assert remove_partial_files() == []
    finally:  # Python's own removal of a tree fails on it
        subprocess.run(["rm", "-rf", name], cwd=INBOX, check=True)


def test_captures_whose_folders_in_quarantine_have_one_name_have_a_reason_each():
    for path, seed in (("s/01", 1), ("s_01", 2)):
        put(path, seed).write_text("1,2")
    assert len(night().quarantined) == len(reasons()) == 2
    for content in ("1,3", "1,4"):  # in the same second, of the same name
        put("s/01").write_text(content)
        assert list(take_captures(settle_s=0.0).quarantined) == ["s/01"]
    texts = [path.read_text() for path in Path("data/quarantine").rglob(NAME)]
    assert sorted(texts) == ["1,2", "1,2", "1,3", "1,4"]


PLANS = {
    "cut short": '[{"name": "a"',
    "another object": '[{"what": 1}]',
    "not a list": "3",
    "files that are gone": '[{"name": "a", "files": ["gone/x"], "to": "data/captures/lab"}]',
    "a target of other content": json.dumps(
        [{"name": "a", "files": [f"a/{NAME}"], "to": RAW.as_posix()}]
    ),
}


@pytest.mark.parametrize("plan", PLANS)
def test_a_plan_that_cannot_be_carried_out_is_set_aside_and_nothing_is_lost(plan):
    put("a", 1)
    if "target" in plan:
        (RAW / "a").mkdir()
        (RAW / "a" / NAME).write_text(capture(2))
    INTAKE_PLAN.parent.mkdir(exist_ok=True)
    INTAKE_PLAN.write_text(PLANS[plan])
    night()
    assert not INTAKE_PLAN.exists()
    kept = [*RAW.rglob(NAME), *Path("data/quarantine").rglob(NAME)]
    assert capture(1) in [path.read_text() for path in kept]


def test_what_a_run_leaves_half_written_is_never_looked_for_in_the_inbox():
    dropped = put("a", 1).with_name(".take.999999999")
    dropped.write_text("dropped")
    assert remove_partial_files() == [] and dropped.exists()


def test_a_name_that_is_not_utf8_is_quarantined_with_its_content():
    put(b"caf\xe9")
    (reason,) = night().quarantined.values()
    assert reason == f"its name caf\\udce9/{NAME} is not UTF-8"
    (kept,) = Path("data/quarantine").rglob(NAME)
    assert kept.read_text() == capture(0)


def test_a_file_where_a_folder_is_wanted_is_a_reason():
    put("s/01", 1)
    put("t", 2)
    (RAW / "s").write_text("a file")
    (RAW / "t" / NAME).mkdir(parents=True)
    quarantined = night().quarantined
    assert quarantined["s/01"] == f"{RAW}/s is a file, where a folder is wanted"
    assert quarantined["t"] == f"{RAW}/t/{NAME} is a folder"


def test_a_pipe_among_the_captures_is_not_opened():
    put("a", 1)
    (RAW / "a").mkdir()
    os.mkfifo(RAW / "a" / NAME)
    assert night().quarantined == {"a": f"{RAW}/a/{NAME} exists, with other content"}


def test_of_two_captures_that_come_to_one_name_the_second_is_quarantined():
    put("a b", 1)
    put("a-u20-b", 2)
    result = night()
    assert result.accepted == ("a-u20-b", "good")
    assert result.quarantined["a-u20-b"] == f"the name a-u20-b is that of a b/{NAME}"
    put("c d", 3)
    assert take_captures(settle_s=0.0).accepted == ("c-u20-d",)
    put("c-u20-d", 4)
    late = take_captures(settle_s=0.0).quarantined
    assert late == {"c-u20-d": f"the name c-u20-d is that of {RAW}/c d/{NAME}"}


def test_what_is_refused_for_its_name_makes_the_same_content_no_double():
    put("c d", 3)
    assert take_captures(settle_s=0.0).accepted == ("c-u20-d",)
    put("c-u20-d", 4)
    put("e", 4)
    put("f", 4)
    result = take_captures(settle_s=0.0)
    assert result.accepted == ("e",)
    assert result.quarantined == {
        "c-u20-d": f"the name c-u20-d is that of {RAW}/c d/{NAME}",
        "f": "the same content as e",
    }


def test_control_characters_of_names_reach_no_terminal(capsys):
    put("\x1b[31mred\n", 1).write_text("1,2\x1b[2J\n")
    (INBOX / "\x1b[2Jnotes\n").write_text("no capture")
    os.mkfifo(INBOX / "pipe")
    result = night()
    assert result.waiting == ("\\x1b[2Jnotes\\n", "pipe")
    shown = "\n".join(status_lines(project_status(stale=False)))
    facts = json.dumps([vars(result), reasons()], ensure_ascii=False) + capsys.readouterr().err
    assert "\\x1b[2Jnotes" in shown
    assert "\x1b" not in shown + facts


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("nowhere")])
def test_a_folder_of_captures_that_dvc_cannot_hash_is_named_in_one_line(make):
    make(RAW / "odd")
    for ask in (read_status, lambda: upstream_and_stale([])):
        with pytest.raises(CommandError, match=rf"{RAW}/odd: .*; remove it"):
            ask()


def test_captures_that_ingestion_could_not_use_are_counted(tmp_path):
    assert "unusable" not in "\n".join(status_lines(project_status(stale=False)))
    table = tmp_path / "data/sequences/quarantine.parquet"
    table.parent.mkdir(parents=True, exist_ok=True)
    write_rows(table, QuarantineRecord, [QuarantineRecord("s", "f", "0", 1, "r")])
    shown = list(status_lines(project_status(stale=False)))
    assert "unusable      1 captures, which pacmo quarantine lists" in shown
    table.chmod(0o644)
    table.write_text("garbage")
    (line,) = (one for one in status_lines(project_status(stale=False)) if "unusable" in one)
    assert "unknown: data/sequences/quarantine.parquet: not a complete Parquet file" in line


def test_an_unreadable_reason_hides_no_other(tmp_path):
    for name, text in (("a", "{"), ("b", '{"name": "b", "reason": "short", "line": 0}')):
        (tmp_path / f"data/quarantine/{name}").mkdir(parents=True)
        (tmp_path / f"data/quarantine/{name}/reason.json").write_text(text)
    shown = "\n".join(status_lines(project_status(stale=False)))
    assert "a/reason.json cannot be read" in shown and "b: short" in shown


@pytest.mark.parametrize("dataset", ["another", "lab"])
def test_captures_are_compared_with_those_of_the_experiment_alone(dataset: str) -> None:
    """What was ingested last may be of another experiment, with other joints."""
    row = {
        **dict.fromkeys(("clip", "sequence", "recording", "source_file"), "x"),
        "dataset": dataset,
        "action": "",
        "subject_a": "",
        "subject_b": "",
        "skeleton": "sbu",
        "fps": 15.0,
        "duration": 1.0,
        "frames": 15,
        "start_frame": 0,
        "sha256": "0",
        "bone_length_variation": 0.0,
        "max_joint_speed": 0.0,
        "contact_share": 0.0,
        "filled_frames": 0,
        "synthetic": False,
    }
    write_rows(Path("data/sequences/clips.parquet"), ClipRecord, [ClipRecord(**row)])
    with write_motions(Path("data/sequences/motions.parquet"), NTU25):
        pass
    put("one", 1)
    result = take_captures(settle_s=0.0)
    if dataset == "another":
        assert result.accepted == ("one",)
    else:
        assert "without spine_base" in result.quarantined["one"]
        assert "where the captures have 25 (ntu25)" in result.quarantined["one"]
