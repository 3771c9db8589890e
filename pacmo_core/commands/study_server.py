"""The web server of a study: one page and four endpoints, safe on the public web.

It reveals nothing about the machine, stores no addresses, accepts small and well-formed requests
only, and limits their rate.
"""

import secrets
import threading
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from fastapi import APIRouter, FastAPI, Path, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse
from pydantic import BaseModel, ConfigDict, Field, StrictBool

from pacmo_core.commands.study_store import Study, balanced_sample
from pacmo_core.figures.history import render_study

TOKEN = r"^[A-Za-z0-9_-]{22}$"  # 128 random bits
MAX_BODY = 1000  # bytes
MAX_REFERENCES = 1000
MAX_ADDRESSES = 50_000
Person = Annotated[str, Path(pattern=TOKEN)]
Place = Annotated[int, Path(ge=0, lt=MAX_REFERENCES)]
Next = Callable[[Request], Awaitable[Response]]


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


@dataclass
class RateLimiter:
    """A token bucket for each address.

    Addresses are held in memory only; those with the oldest requests are removed.

    Parameters
    ----------
    rate : requests per second
    burst : requests at once
    """

    rate: float
    burst: float
    _seen: dict[str, tuple[float, float]] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def allows(self, address: str, now: float) -> bool:
        """Count a request; return whether it is within the limit."""
        with self._lock:
            remaining, then = self._seen.pop(address, (self.burst, now))
            remaining = min(self.burst, remaining + (now - then) * self.rate)
            self._seen[address] = (remaining - 1 if remaining >= 1 else remaining, now)
            if len(self._seen) > MAX_ADDRESSES:
                del self._seen[next(iter(self._seen))]
            return remaining >= 1


@dataclass(frozen=True)
class StudySettings:
    """Clips per participant, and the maximum number of participants."""

    per_person: int
    people: int


def create_app(study: Study, settings: StudySettings, limiter: RateLimiter) -> FastAPI:
    """Return the web application of a study.

    Raises
    ------
    ValueError
        If the study has too few clips.
    """
    random = np.random.default_rng()
    balanced_sample(study.candidates(), settings.per_person, random)
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    page, policy = render_study()

    @app.middleware("http")
    async def guard(request: Request, call_next: Next) -> Response:
        response = _refusal(request, limiter) or await call_next(request)
        response.headers["Content-Security-Policy"] = policy
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cache-Control"] = "no-store"
        return response

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, __: RequestValidationError) -> Response:
        return JSONResponse({"error": "malformed request"}, 422)

    @app.get("/")
    def show() -> Response:
        return HTMLResponse(page)

    app.include_router(_endpoints(study, settings, random))
    return app


def _endpoints(study: Study, settings: StudySettings, random: np.random.Generator) -> APIRouter:
    """Return the endpoints that the page in the browser uses."""
    router = APIRouter()

    @router.post("/begin")
    def begin(_: ConsentForm) -> Response:
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


def _refusal(request: Request, limiter: RateLimiter) -> Response | None:
    """Reject requests that are too large or too frequent, before they are read."""
    length = request.headers.get("content-length", "")
    if request.method == "POST" and not (length.isdecimal() and int(length) <= MAX_BODY):
        return JSONResponse({"error": "too large"}, 413)
    address = request.client.host if request.client else ""
    if not limiter.allows(address, time.monotonic()):
        return JSONResponse({"error": "too fast"}, 429, {"Retry-After": "1"})
    return None
