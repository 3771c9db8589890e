"""The web server of a study: one page and four endpoints, safe on the public web.

It reveals nothing about the machine, stores no addresses, accepts small and well-formed requests
only, and limits their rate.
"""

import secrets
import sqlite3
import sys
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import uvicorn
from fastapi import APIRouter, FastAPI, Path, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse
from pydantic import BaseModel, ConfigDict, Field, StrictBool

from pacmo_core.commands.study_clips import balanced_sample
from pacmo_core.commands.study_limits import (
    ACCEPTS_AT_ONCE,
    Guard,
    ParticipantLimiter,
    RateLimiter,
    bounded_protocol,
    client_of,
    max_connections,
)
from pacmo_core.commands.study_store import Study
from pacmo_core.figures.history import render_study

TOKEN = r"^[A-Za-z0-9_-]{22}$"  # 128 random bits
MAX_REFERENCES = 1000
# Every response has one of these: done; not HTTP or no JSON; too many participants of an address;
# no such page, participant or place; another method; the study is complete; too large; malformed;
# too fast; the disk is full. There is no 500.
STATUSES = (200, 400, 403, 404, 405, 410, 413, 422, 429, 503)
Person = Annotated[str, Path(pattern=TOKEN)]
Place = Annotated[int, Path(ge=0, lt=MAX_REFERENCES)]
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class ConsentForm(BaseModel):
    """The consent of a participant."""

    model_config = ConfigDict(extra="forbid")
    consent: Literal[True]


class AnswerForm(BaseModel):
    """The answer of a participant: whether a clip is real."""

    model_config = ConfigDict(extra="forbid")
    person: str = Field(pattern=TOKEN)
    place: int = Field(ge=0, lt=MAX_REFERENCES, strict=True)
    real: StrictBool


@dataclass(frozen=True)
class StudySettings:
    """The size of a study.

    Parameters
    ----------
    per_person : clips of a participant
    people : participants at most
    per_address : participants at most that begin from one address while the server runs
    """

    per_person: int
    people: int
    per_address: int


def create_app(study: Study, settings: StudySettings, limiter: RateLimiter) -> FastAPI:
    """Return the web application of a study.

    Raises
    ------
    ValueError
        If the study has too few clips.
    """
    random = np.random.default_rng()
    balanced_sample(study.candidates(), settings.per_person, random)
    # A redirect would repeat the address that the request claims in its header Host.
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None, redirect_slashes=False)
    page, policy = render_study()

    headers = {"Content-Security-Policy": policy, **HEADERS}
    app.add_middleware(Guard, limiter=limiter, headers=headers)

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, __: RequestValidationError) -> Response:
        return JSONResponse({"error": "malformed request"}, 422)

    @app.exception_handler(sqlite3.Error)
    async def not_saved(_: Request, error: sqlite3.Error) -> Response:
        # A full disk, say. The page tries again.
        sys.stderr.write(f"pacmo: the study cannot be read or written: {error}\n")
        return JSONResponse({"error": "nothing was saved"}, 503)

    @app.get("/")
    def show() -> Response:
        return HTMLResponse(page)

    app.include_router(_endpoints(study, settings, random))
    return app


def _endpoints(study: Study, settings: StudySettings, random: np.random.Generator) -> APIRouter:
    """Return the endpoints that the page in the browser uses."""
    router = APIRouter()
    limiter = ParticipantLimiter(settings.per_address)

    @router.post("/begin")
    def begin(request: Request, _: ConsentForm) -> Response:
        if not limiter.allows(client_of(request)):
            return JSONResponse({"error": "too many participants from this address"}, 403)
        person = secrets.token_urlsafe(16)
        # The study calls this under its lock: one sample at a time.
        count = study.begin(
            person, lambda seen: balanced_sample(seen, settings.per_person, random), settings.people
        )
        if not count:
            return JSONResponse({"error": "the study is complete"}, 410)
        return JSONResponse({"person": person, "count": count})

    @router.get("/progress/{person}")
    def progress(person: Person) -> Response:
        count, answered = study.progress(person)
        if not count:
            return _not_found()
        return JSONResponse({"count": count, "answered": answered})

    @router.get("/clip/{person}/{place}")
    def clip(person: Person, place: Place) -> Response:
        scene = study.scene(person, place)
        return _not_found() if scene is None else Response(scene, media_type="application/json")

    @router.post("/answer")
    def answer(verdict: AnswerForm) -> Response:
        saved = study.answer(verdict.person, verdict.place, real=verdict.real)
        return JSONResponse({"kept": True}) if saved else _not_found()

    return router


def _not_found() -> Response:
    return JSONResponse({"error": "no such participant or place"}, 404)


def run_server(page: FastAPI, host: str, port: int) -> None:
    """Serve the page until stopped."""
    # No access log: addresses are personal data.
    uvicorn.run(
        page,
        host=host,
        port=port,
        log_level="warning",
        access_log=False,
        server_header=False,
        forwarded_allow_ips="127.0.0.1",
        http=bounded_protocol(max_connections()),
        ws="none",
        backlog=ACCEPTS_AT_ONCE,
    )
