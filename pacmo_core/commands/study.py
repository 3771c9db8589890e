"""``pacmo study``: a perceptual study, blind and balanced; nobody sees a clip in both forms."""

import hashlib
import json
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from pacmo_core.commands.study_clips import CUTOFF_HZ, sample_items
from pacmo_core.commands.study_store import GENERATED, REAL, Answer, Study, write_study
from pacmo_core.metrics.survey import Share, fit_mixed, share
from pacmo_core.project.workspace import (
    MOTIONS,
    CommandError,
    in_project,
    reading_errors_in_one_line,
)
from pacmo_core.store.files import write_text

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Can people distinguish generated from captured motion?",
)
_ADDRESSES = 50  # at least so many take part, unless --per-address says otherwise
CLIPS, REACTIONS = in_project(Path("data/clips")), in_project(Path("data/reactions/1/pacmo/1"))
File = Annotated[Path, typer.Argument(help="file of the study")]


@app.command()
def make(  # typer reads the options off the signature
    study: File,
    clips: Annotated[Path, typer.Option(help="captured clips")] = CLIPS,
    reactions: Annotated[Path, typer.Option(help="reactions of a model")] = REACTIONS,
    count: Annotated[int, typer.Option(min=2, help="number of clips, each in both forms")] = 40,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    cutoff: Annotated[
        float, typer.Option(min=0.5, max=15, help="hertz above which both kinds are smoothed")
    ] = CUTOFF_HZ,
) -> None:
    """Create a study of random clips: each as captured, and with the reaction of a model."""
    with reading_errors_in_one_line():
        random = np.random.default_rng(seed)
        items = list(sample_items(clips, reactions, count, random, cutoff))
        of = reactions / MOTIONS
        digest = hashlib.sha256(of.read_bytes()).hexdigest()
        facts = {"reactions": of.as_posix(), "reactions_sha256": digest, "cutoff_hz": f"{cutoff:g}"}
        write_study(study, items, facts)
    typer.echo(f"{study}: {count} captured and {count} generated clips")


@app.command()
def serve(  # noqa: PLR0913  # typer reads the options off the signature
    study: File,
    host: Annotated[str, typer.Option(help="address to listen on; 0.0.0.0 for all")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8000,
    per_person: Annotated[int, typer.Option(min=1, help="clips per participant")] = 14,
    people: Annotated[int, typer.Option(min=1, help="maximum number of participants")] = 1000,
    per_address: Annotated[
        int | None,
        typer.Option(min=1, help="participants from one address; a fiftieth of --people if absent"),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.1, help="requests per second and address")] = 10,
    burst: Annotated[float, typer.Option(min=1, help="requests at once per address")] = 100,
) -> None:
    """Serve the study until stopped. Answers are saved at once; a restarted server continues.

    On the web, run it behind an HTTPS proxy on this machine that sets X-Forwarded-For. The address
    in this header is trusted from the proxy only; it serves to limit the rate of requests.
    """
    # Imported by this command alone: the packages of a server are an extra.
    server = import_module("pacmo_core.commands.study_server")
    with reading_errors_in_one_line():
        opened = Study(study)
        sizes = server.StudySettings(
            per_person, people, per_address or max(1, people // _ADDRESSES)
        )
        page = server.create_app(opened, sizes, server.RateLimiter(rate, burst))
    typer.echo(f"http://{host}:{port}", err=True)
    server.run_server(page, host, port)
    opened.close()
    typer.echo(f"stopped; the answers are in {study}", err=True)


@app.command()
def report(
    study: File,
    out: Annotated[Path | None, typer.Option(help="also write the result as JSON")] = None,
) -> None:
    """Count the answers: the share of each kind that was judged real (PaCMO, table 3)."""
    with reading_errors_in_one_line():
        opened = Study(study)
        answers = opened.answers()
        result = {**count_answers(answers), "of": opened.facts()}
        if out:
            write_text(out, json.dumps(result, indent=2) + "\n")
    table = Table("", "captured", "generated", box=None)
    for name, verdict in (("judged real", "real"), ("judged generated", "made_up")):
        table.add_row(
            name, *(_share_text(Share(**result[kind][verdict])) for kind in (REAL, GENERATED))
        )
    Console().print(table)
    typer.echo(
        f"{len(answers)} answers of {result['people']} people. {_bias_text(result['mixed'])}"
    )


def count_answers(answers: list[Answer]) -> dict[str, Any]:
    """Return the shares and the mixed model as JSON values.

    Raises
    ------
    CommandError
        If clips of one kind were not judged.
    """
    if {answer.kind for answer in answers} != {REAL, GENERATED}:
        raise CommandError(f"wanted answers to clips of both kinds; got {len(answers)} answers")
    result: dict[str, Any] = {"people": len({answer.person for answer in answers})}
    for kind in (REAL, GENERATED):
        verdicts = [answer.real for answer in answers if answer.kind == kind]
        n_real = sum(verdicts)
        result[kind] = {
            "real": asdict(share(n_real, len(verdicts))),
            "made_up": asdict(share(len(verdicts) - n_real, len(verdicts))),
        }
    columns = zip(*((a.person, a.item, a.kind == REAL, a.real) for a in answers), strict=True)
    result["mixed"] = asdict(fit_mixed(*columns))
    return result


def _share_text(real: Share) -> str:
    return f"{real.mean:.2f} ({real.low:.2f} … {real.high:.2f}), {real.count} of {real.of}"


def _bias_text(mixed: dict[str, float]) -> str:
    return (
        "Captured clips are judged real more often by {difference:.2f} logits ({low:.2f} to "
        "{high:.2f}); standard deviation of people {person_spread:.2f}, of clips {clip_spread:.2f}."
    ).format(**mixed)
