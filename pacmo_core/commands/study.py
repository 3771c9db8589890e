"""What a study shows, and to whom: blind, balanced, no clip twice in two forms to one person."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import uvicorn
from rich.console import Console
from rich.table import Table

from pacmo_core.commands.study_server import RateLimiter, StudySettings, create_app
from pacmo_core.commands.study_store import (
    GENERATED,
    REAL,
    Answer,
    Study,
    sample_items,
    write_study,
)
from pacmo_core.metrics.survey import Share, fit_mixed, share
from pacmo_core.project.workspace import MOTIONS, CommandError, reading_errors_in_one_line
from pacmo_core.store.files import write_text

app = typer.Typer(no_args_is_help=True, help="Can people tell generated motion from captured?")
MAX_CONNECTIONS = 2000
File = Annotated[Path, typer.Argument(help="the study's file")]


@app.command()
def make(
    study: File,
    clips: Annotated[Path, typer.Option(help="captured clips")] = Path("data/clips"),
    reactions: Annotated[Path, typer.Option(help="a model's")] = Path("data/reactions/1/pacmo/1"),
    count: Annotated[int, typer.Option(min=2, help="clips to draw, shown in both forms")] = 40,
    seed: Annotated[int, typer.Option(min=0)] = 0,
) -> None:
    """Draw clips into a new study: each as captured, and with a model's reaction."""
    with reading_errors_in_one_line():
        random = np.random.default_rng(seed)
        items = list(sample_items(clips, reactions, count, random))
        of = reactions / MOTIONS
        digest = hashlib.sha256(of.read_bytes()).hexdigest()
        write_study(study, items, {"reactions": of.as_posix(), "reactions_sha256": digest})
    typer.echo(f"{study}: {count} captured and {count} generated clips")


@app.command()
def serve(  # noqa: PLR0913  # typer reads the options off the signature
    study: File,
    host: Annotated[str, typer.Option(help="0.0.0.0 lets others in")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8000,
    per_person: Annotated[int, typer.Option(min=1, help="clips that a participant judges")] = 14,
    people: Annotated[int, typer.Option(min=1, help="at most; the rest are turned away")] = 1000,
    rate: Annotated[float, typer.Option(min=0.1, help="questions a second an address")] = 10,
    burst: Annotated[float, typer.Option(min=1, help="questions at once an address")] = 100,
) -> None:
    """Serve the page until stopped; answers are kept as they come, and a restart goes on.

    Put it on the web behind a proxy on this machine that speaks HTTPS and sets X-Forwarded-For:
    from there, and from nowhere else, the address in it is believed, to limit the rate of each.
    """
    with reading_errors_in_one_line():
        opened = Study(study)
        page = create_app(opened, StudySettings(per_person, people), RateLimiter(rate, burst))
    typer.echo(f"http://{host}:{port}", err=True)
    # No log of who came: addresses are personal.
    uvicorn.run(
        page,
        host=host,
        port=port,
        log_level="warning",
        access_log=False,
        server_header=False,
        forwarded_allow_ips="127.0.0.1",
        limit_concurrency=MAX_CONNECTIONS,
    )
    opened.close()


@app.command()
def report(
    study: File, out: Annotated[Path | None, typer.Option(help="also as JSON")] = None
) -> None:
    """Count the answers: the share of either kind that was taken for real (PaCMO, table 3)."""
    with reading_errors_in_one_line():
        opened = Study(study)
        answers = opened.answers()
        result = {**count_answers(answers), "of": opened.facts()}
        if out:
            write_text(out, json.dumps(result, indent=2) + "\n")
    table = Table("", "captured", "generated", box=None)
    for name, verdict in (("taken for real", "real"), ("taken for made up", "made_up")):
        table.add_row(
            name, *(_share_text(Share(**result[kind][verdict])) for kind in (REAL, GENERATED))
        )
    Console().print(table)
    typer.echo(
        f"{len(answers)} answers of {result['people']} people. {_bias_text(result['mixed'])}"
    )


def count_answers(answers: list[Answer]) -> dict[str, Any]:
    """Give the table and the mixed model, ready for JSON.

    Raises
    ------
    CommandError
        If not both kinds were judged.
    """
    if {answer.kind for answer in answers} != {REAL, GENERATED}:
        raise CommandError(f"wanted answers to clips of both kinds; got {len(answers)} answers")
    result: dict[str, Any] = {"people": len({answer.person for answer in answers})}
    for kind in (REAL, GENERATED):
        text = [answer.real for answer in answers if answer.kind == kind]
        taken_for_real = sum(text)
        result[kind] = {
            "real": asdict(share(taken_for_real, len(text))),
            "made_up": asdict(share(len(text) - taken_for_real, len(text))),
        }
    columns = zip(*((a.person, a.item, a.kind == REAL, a.real) for a in answers), strict=True)
    result["mixed"] = asdict(fit_mixed(*columns))
    return result


def _share_text(found: Share) -> str:
    return f"{found.mean:.2f} ({found.low:.2f} … {found.high:.2f}), {found.count} of {found.of}"


def _bias_text(mixed: dict[str, float]) -> str:
    return (
        "Captured clips are taken for real more often by {difference:.2f} logits ({low:.2f} to "
        "{high:.2f}), people leaning by {person_spread:.2f} and clips by {clip_spread:.2f}."
    ).format(**mixed)
