"""Truth: the exit codes and the table of contents that the help promises."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pacmo_core.commands.cli import COMMANDS, app
from pacmo_core.project.workspace import CommandError, errors_in_one_line


def pacmo(*words: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, list(words))
    return result.exit_code, result.stdout, result.stderr


def test_help_is_a_table_of_contents() -> None:
    code, out, _ = pacmo("--help")
    assert code == 0
    assert "fetch" in out
    assert "Exit codes: 0 done; 1" in out


def test_fetch_lists_its_datasets_and_explains_checksums() -> None:
    code, out, _ = pacmo("fetch", "--help")
    assert code == 0
    for word in ("sbu", "cmu-two-person", "SHA256SUMS", "A second run"):
        assert word in out


@pytest.mark.parametrize("name", ["sbu", "cmu-two-person"])
def test_a_command_gives_examples_that_stand_each_on_a_line(name: str) -> None:
    code, out, _ = pacmo("fetch", name, "--help")
    assert code == 0
    assert f"  pacmo fetch {name} data/captures\n" in out


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["fetch", "sbu"], "DEST"),
        (["fetch", "nothing"], "nothing"),
        (["fetch", "sbu", "x", "--only", "s09s09"], "s09s09"),
        (["fetch", "sbu", "x", "--base-url", "ftp://host/x"], "http or https"),
        (["fetch", "sbu", "x", "--base-url", "file:///x"], "http or https"),
        (["fetch", "sbu", "x", "--base-url", "http://"], "http or https"),
        (["fetch", "sbu", "x", "--base-url", "http://host:port"], "http or https"),
    ],
)
def test_wrong_usage_ends_with_2_and_names_the_word(
    words: list[str], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = pacmo(*words)
    assert code == 2
    assert reason in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["react", "x.bvh", "--out", "a.bvh", "--samples", "2", "--out=b.bvh"], "--out"),
        (["react", "x.bvh", "--out", "a.bvh", "--seed", "0", "--seed", "0"], "--seed"),
        (["react", "x.bvh", "--finish", "--no-finish"], "--finish/--no-finish"),
        (["vary", "--seed", "1", "x.bvh", "y.bvh", "--seed", "2"], "--seed"),
        (["study", "make", "x", "--seed", "1", "--seed", "2"], "--seed"),
        (["fetch", "sbu", "x", "--base-url", "http://a", "--base-url", "http://b"], "--base-url"),
    ],
)
def test_an_option_of_one_value_is_given_once(words: list[str], option: str) -> None:
    code, _, err = pacmo(*words)
    assert code == 2
    assert f"Error: {option}: wanted once; got 2 times\n" in err


def test_an_option_of_several_values_is_given_several_times(tmp_path: Path) -> None:
    words = ["--from-unit", "a=cm", "--from-unit", "b=m", "--joints", "cmu", "--joints", "head=x"]
    code, _, err = pacmo("react", str(tmp_path / "x.bvh"), "--out", str(tmp_path / "y"), *words)
    assert code == 1
    assert err.endswith("x.bvh: cannot be read: No such file or directory\n")


@pytest.mark.parametrize(
    ("word", "meant"), [("reakt", "react"), ("augument", "augment"), ("experiment", "experiments")]
)
def test_the_command_that_was_meant_is_named(word: str, meant: str) -> None:
    code, _, err = pacmo(word, "x.bvh")
    assert code == 2
    assert f"No such command '{word}'; did you mean {meant}?" in err


def test_a_command_like_no_other_names_none() -> None:
    code, _, err = pacmo("zzz")
    assert code == 2
    assert "No such command 'zzz'.\n" in err


def test_a_destination_that_is_a_file_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code, _, err = pacmo("fetch", "sbu", str(tmp_path / "file"))
    assert code == 1
    assert err.startswith("pacmo: ")
    assert err.count("\n") == 1
    assert "file" in err


def test_a_failure_of_many_lines_is_told_in_one(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_, errors_in_one_line():
        raise CommandError("first\nsecond")
    assert exit_.value.code == 1
    assert capsys.readouterr().err == "pacmo: first second\n"


def test_a_bug_keeps_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError), errors_in_one_line():
        _ = 1 / 0


@pytest.mark.slow
def test_no_traceback_reaches_a_person_without_a_network(tmp_path: Path) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # bound and not listening: refuses
        url = f"http://127.0.0.1:{closed.getsockname()[1]}"
        command = [
            "-m",
            "pacmo_core.commands.cli",
            "fetch",
            "sbu",
            str(tmp_path),
            "--base-url",
            url,
        ]
        run = subprocess.run(
            [sys.executable, *command], capture_output=True, text=True, check=False, env={}
        )
    assert run.returncode == 1
    assert run.stderr.startswith("pacmo: cannot reach 127.0.0.1")
    assert run.stderr.count("\n") == 1


WITHOUT_EXTRAS = """
import sys
from pacmo_core.commands import cli
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("dvc", "dvclive", "prefect", "fastapi", "starlette", "uvicorn",
                                  "networkx", "sqlalchemy", "psutil"):
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Missing())
cli.main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("words", [[name, "--help"] for name in COMMANDS] + [
    ["study", command, "--help"] for command in ("make", "serve", "report")
], ids=" ".join)  # fmt: skip
def test_help_needs_no_extra(words: list[str]) -> None:
    command = [sys.executable, "-c", WITHOUT_EXTRAS, *words]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("Usage: pacmo")


@pytest.mark.slow
def test_a_command_whose_extra_is_missing_names_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WITHOUT_EXTRAS, "study", "serve", str(tmp_path / "x")]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert "pip install 'pacmo[pipeline]'" in run.stderr and run.stderr.count("\n") == 1
