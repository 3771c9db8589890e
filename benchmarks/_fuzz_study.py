"""Random HTTP requests for ``benchmarks.robustness``: to the real server of a study, on loopback.

A request is valid, odd in its terms (method, path, headers, length, JSON) or spoilt byte by byte.
Every response has one of the documented statuses, the server answers the next request, takes no
more memory, and holds just the answers that it has acknowledged, the first one to each clip.
"""

import json
import re
import socket
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import httpx

from benchmarks._fuzz_binary import ODD_VALUES
from benchmarks._fuzz_texts import ODD_NUMBERS, Grammar
from pacmo_core.commands.study_server import STATUSES
from tests.commands.studies import served, small_study

PER_PERSON = 14
MAX_GROWTH_BYTES = 20 << 20
WARM_UP = 300  # requests, after which the server's memory is taken
# As long as a participant's token, in whose place they are: participants begin at run time.
TOKENS = tuple(f"{name:-<22}" for name in ("first", "second", "spoilt"))
FIRST = TOKENS[0]
# Of the clock, below that of a case: the server shares a busy machine, and 9 s were too few there.
PATIENCE_S = 45.0
SILENCE_S = 0.25  # after which the server is taken to wait for the rest of a request
CONTINUE = b"HTTP/1.1 100 Continue\r\n\r\n"
_STATUS = re.compile(rb"^HTTP/1\.1 (\d{3}) ")
_LENGTH = re.compile(rb"\r\ncontent-length: (\d+)\r\n", re.IGNORECASE)
METHODS = ("GET", "POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "CONNECT", "get", "G T", "")
PATHS = (
    *("/", "/begin", "/answer", f"/progress/{FIRST}", f"/clip/{FIRST}/0", f"/clip/{FIRST}/99"),
    *("/progress/x", "/clip/../../etc/passwd", "//", "*", "http://x/", "/%00", "/%ff", "/docs"),
    *("/progress/" + "A" * 22, f"/clip/{FIRST}/%D9%A3", f"/clip/{FIRST}/-1", "/\x00", "/\xe9"),
    *(f"/clip/{FIRST}/1e400", "", f"/clip/{FIRST}/" + "9" * 400, "/?" + "a" * 3000, "/begin/"),
    *(f"/answer?person={FIRST}", f"/clip/{FIRST}/1_0", f"/clip/{FIRST}/1.0", "/clip//0"),
)
HEADERS = (
    *("Transfer-Encoding: chunked", "Transfer-Encoding: gzip, chunked", "Expect: 100-continue"),
    *("Connection: close", "Connection: upgrade\r\nUpgrade: websocket", "Content-Type: text/plain"),
    *("Content-Type: application/json; charset=utf-16", "Content-Encoding: gzip", "X: \xff"),
    *("X-Forwarded-For: 1.2.3.4", "X-Forwarded-For: \xff,,", "Host: a\r\nHost: b", "X: a\r\n b"),
    *("Content-Length: 3\r\nContent-Length: 4", "Content-Length: -1", "Content-Length: 1e3"),
    *("Content-Length: 999999999", "X: " + "y" * 2000, "Range: bytes=0-1", ": x", "Cookie: a=b"),
    *("Content-Length: \xb2", "X\x00: y", "Content-Length: +5", "Content-Length: 0x5"),
)


@dataclass(frozen=True)
class Request:
    """One request, as text of latin-1, and the answer in it.

    Parameters
    ----------
    text : with ``TOKENS`` for participants
    answer : token, place and verdict that it sends, if it is an answer to be checked
    """

    text: str
    answer: tuple[str, int, bool] | None = None


@contextmanager
def serving_study(folder: Path) -> Iterator[None]:
    """Serve a small study while the block runs; ``study.json`` in the folder names the server."""
    study = small_study(folder / "study.sqlite")
    with served(study, 0, "--people", "1000000") as (address, process):
        facts = {"port": int(address.rpartition(":")[2]), "pid": process.pid}
        (folder / "study.json").write_text(json.dumps(facts))
        yield


def write_requests(grammar: Grammar, folder: Path) -> None:
    """Write random requests as JSON."""
    requests = [_request(grammar) for _ in range(grammar.integer(1, 9))]
    (folder / "requests.json").write_text(json.dumps([vars(r) for r in requests]))


def _request(g: Grammar) -> Request:
    kind = g.integer(0, 8)
    if kind < 3:
        return _answer(g)
    if kind == 3:
        return Request(_http(g, "POST", "/begin", _json(g, {"consent": True})))
    if kind == 4:
        text = _answer(g).text.replace(TOKENS[0], TOKENS[2]).replace(TOKENS[1], TOKENS[2])
        return Request(_spoil(g, text))
    method = g.pick(METHODS) if g.odd() else g.pick(METHODS[:2])
    path = g.pick(PATHS) if g.integer(0, 2) else g.pick(PATHS[:6])
    return Request(_http(g, method, path, "" if g.integer(0, 3) else _json(g, {"consent": True})))


def _answer(g: Grammar) -> Request:
    token, place, real = g.pick(TOKENS[:2]), g.integer(0, PER_PERSON), bool(g.integer(0, 2))
    content = {"person": token, "place": place, "real": real}
    body = _json(g, content)
    canonical = body == json.dumps(content)
    if not canonical:
        body = body.replace(TOKENS[0], TOKENS[2]).replace(TOKENS[1], TOKENS[2])
    return Request(_http(g, "POST", "/answer", body), (token, place, real) if canonical else None)


def _json(g: Grammar, content: dict[str, object]) -> str:
    """Write JSON of a valid form, or of another shape."""
    odd = g.integer(0, 12)
    if odd == 0:
        name = g.pick(tuple(content))
        content = {**content, name: ODD_VALUES[g.integer(0, len(ODD_VALUES))]}
    elif odd == 1:
        content = {**content, "more": 1}
    elif odd == 2:
        return g.pick(("[" * 900, '{"a":' * 150, "\xff\xfe", "", "null", "[]", '"x"', "nan", "{"))
    elif odd == 3:
        return json.dumps(content)[:-1] + f', "place": {g.pick(ODD_NUMBERS[:14])}}}'
    return json.dumps(content)


def _http(g: Grammar, method: str, path: str, body: str) -> str:
    headers = ["Host: study"] * (not g.odd()) + ["Content-Type: application/json"] * (not g.odd())
    if body or method == "POST":
        length = len(body.encode("latin-1", "replace"))
        length += g.integer(-3, 4) if g.odd() else 0
        headers += [f"Content-Length: {length}"] * (not g.odd())
    headers += [g.pick(HEADERS)] * g.odd() + [g.pick(HEADERS)] * (g.integer(0, 8) == 0)
    version = g.pick(("HTTP/1.0", "HTTP/2", "HTTP/1.1 ", "http/1.1", "")) if g.odd() else "HTTP/1.1"
    return f"{method} {path} {version}\r\n" + "\r\n".join(headers) + "\r\n\r\n" + body


def _spoil(g: Grammar, text: str) -> str:
    at, stop = sorted(g.random.integers(0, len(text) + 1, 2).tolist())
    noise = g.random.bytes(8).decode("latin-1")
    return (text[:at], text[:at] + noise + text[at:], text[:at] + text[stop:], noise * 40)[
        g.integer(0, 4)
    ]


class NoneTakenError(ValueError):
    """Every request was refused."""


def read_requests(folder: Path, server: Path) -> None:
    """Send the requests of a folder and check every response, then what the study holds.

    Parameters
    ----------
    server : folder of ``serving_study``

    Raises
    ------
    NoneTakenError
        If the server took none.
    RuntimeError
        If a response, the answers or the memory of the server are not as they must be.
    """
    facts = json.loads((server / "study.json").read_text())
    address = f"http://127.0.0.1:{facts['port']}"
    with httpx.Client(base_url=address, timeout=PATIENCE_S) as web:
        people = {t: web.post("/begin", json={"consent": True}).json()["person"] for t in TOKENS}
        sent = Sent()
        for fields in json.loads((folder / "requests.json").read_text()):
            status = _send(facts["port"], _with_people(fields["text"], people))
            sent.add(Request(fields["text"], fields["answer"]), status)
        for token in TOKENS[:2]:
            sent.check(token, _answers(server, people[token]))
        if web.get("/").status_code != 200:
            raise RuntimeError("the server answers no longer")
    _check_memory(server, facts["pid"], len(sent.statuses))
    if 200 not in sent.statuses:
        raise NoneTakenError(f"statuses {sent.statuses}")


@dataclass
class Sent:
    """What was sent so far, and what the server said.

    Parameters
    ----------
    first : the first acknowledged verdict of each place of a participant
    uncertain : the verdicts of requests without a response, which may be saved or not
    """

    statuses: list[int] = field(default_factory=list)
    first: dict[tuple[str, int], bool] = field(default_factory=dict)
    uncertain: set[tuple[str, int, bool]] = field(default_factory=set)

    def add(self, request: Request, status: int) -> None:
        """Count a request."""
        self.statuses.append(status)
        if request.answer is None:
            return
        token, place, real = request.answer
        if status == 200:
            self.first.setdefault((token, place), real)
        elif status == 0:
            self.uncertain.add((token, place, real))

    def check(self, token: str, held: dict[int, bool]) -> None:
        """Raise RuntimeError unless the study holds what was acknowledged to a participant."""
        wanted = {place: real for (t, place), real in self.first.items() if t == token}
        places = {p for p in {*wanted, *held} if held.get(p) != wanted.get(p)}
        if any((token, place, held.get(place)) not in self.uncertain for place in places):
            raise RuntimeError(f"acknowledged {wanted}, held {held}, perhaps {self.uncertain}")


def _with_people(text: str, people: dict[str, str]) -> bytes:
    for token, person in people.items():
        text = text.replace(token, person)
    return text.encode("latin-1", "replace")


def _send(port: int, request: bytes) -> int:
    """Send a request; return the status, 0 if the server waits for the rest or closes."""
    with closing(socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)) as web:
        with suppress(ConnectionError):
            web.sendall(request)
        return _status(web, b"HEAD" in request[:5])


def _status(web: socket.socket, without_body: bool) -> int:
    received = b""
    web.settimeout(SILENCE_S)
    while not _is_whole(received, without_body):
        try:
            block = web.recv(1 << 16)
        except TimeoutError:
            if received.removeprefix(CONTINUE):
                raise RuntimeError(f"a response without its end: {received[:200]!r}") from None
            return 0
        except ConnectionError:
            return 0
        if not block:
            break
        web.settimeout(PATIENCE_S if block != CONTINUE else SILENCE_S)
        received += block
    return _checked_status(received) if received else 0


def _is_whole(received: bytes, without_body: bool) -> bool:
    head, end, body = received.removeprefix(CONTINUE).partition(b"\r\n\r\n")
    length = _LENGTH.search(head + b"\r\n")
    return bool(end) and (without_body or (length is not None and len(body) >= int(length[1])))


def _checked_status(received: bytes) -> int:
    match = _STATUS.match(received.removeprefix(CONTINUE))
    if match is None or int(match[1]) not in STATUSES:
        raise RuntimeError(f"no documented status: {received[:200]!r}")
    return int(match[1])


def _answers(server: Path, person: str) -> dict[int, bool]:
    """Return the verdicts of a participant by place, from the study's file."""
    with closing(sqlite3.connect(f"file:{server / 'study.sqlite'}?mode=ro", uri=True)) as study:
        rows = study.execute("SELECT place, real FROM answers WHERE person = ?", (person,))
        return {place: bool(real) for place, real in rows}


def _check_memory(server: Path, pid: int, n_requests: int) -> None:
    """Compare the server's peak with that after ``WARM_UP`` requests."""
    note = server / "memory.json"
    count, peak = json.loads(note.read_text()) if note.exists() else (0, 0)
    now = peak_memory(pid)
    if count >= WARM_UP and now - peak > MAX_GROWTH_BYTES:
        raise RuntimeError(f"the server's memory grew by {(now - peak) / 1e6:.1f} MB")
    note.write_text(json.dumps([count + n_requests, peak if count >= WARM_UP else now]))


def peak_memory(pid: int) -> int:
    """Return the largest resident size of a process so far, in bytes."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))
