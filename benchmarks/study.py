"""The server of a study under load, kills and attacks, and what a clip's JSON gives away.

Usage: python -m benchmarks.study [--people N] [--kills N] [--seed S] [--clips N] [--json]

``lost``, ``doubled``, ``changed``: of the answers of all participants, while the server is killed
-9 at random moments and started again; a participant sends every second answer twice, the second
time with the other verdict. ``growth_mb``: of the server's peak memory, by requests of 500 MB of
four kinds. ``kept_out_s``: the longest that a client waits for a page, a participation or an answer
while another one attacks: with half-open connections, with bodies that never come, with
participations. ``accuracy_*``: of a classifier that is fitted to one half of the clips and tells
captured from generated ones in the other by one number of their JSON, and of a logistic regression
on all; ``chance_low``, ``chance_high``: three standard deviations of guesses. Generated is the
hardest case, a reaction by the true distribution without the noise of a camera; ``unblinded_*`` is
what the third difference tells of the motions as they are.
"""

import asyncio
import random
import resource
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import httpx

from benchmarks._figures import arguments, show
from benchmarks._fuzz_study import peak_memory
from benchmarks._study_clips import classify, write_clips
from pacmo_core.commands.study_store import Study
from tests.commands.studies import free_port, served, small_study
from tests.waiting import wait_until

PER_PERSON = 14
MEGABYTE = 1 << 20
N_HALF_OPEN = 2100
ATTACK_S = 15.0
RELOAD = httpx.Timeout(60.0, connect=5.0)
PATIENCE_S = 1800.0  # for all answers
LIMITS = ("--rate", "10", "--burst", "100", "--per-address", "20")  # the command's defaults
OTHER = "127.0.0.2"  # the address of a client beside the attacker's
Kept = dict[tuple[str, int], bool]
BODIES = {
    "chunked beside a length": "Content-Length: 10\r\nTransfer-Encoding: chunked\r\n",
    "chunked": "Transfer-Encoding: chunked\r\n",
    "a true length": f"Content-Length: {500 * MEGABYTE}\r\n",
    "a length that lies": "Content-Length: 900\r\n",
}


async def insist(web: httpx.AsyncClient, path: str, content: object) -> httpx.Response:
    """Send again until there is an answer, as the page does."""
    while True:
        try:
            return await web.post(path, json=content)
        except httpx.TransportError:
            await asyncio.sleep(1)


async def participate(web: httpx.AsyncClient, number: int, kept: Kept) -> None:
    """Answer every clip, some twice, and the second time otherwise.

    Raises
    ------
    RuntimeError
        If the server refuses.
    """
    begun = (await insist(web, "/begin", {"consent": True})).json()
    for place in range(begun["count"]):
        real = (number + place) % 3 > 0
        for said in (real, not real)[: 2 - place % 2]:  # the last one once
            content = {"person": begun["person"], "place": place, "real": said}
            response = await insist(web, "/answer", content)
            if response.json() != {"kept": True}:
                raise RuntimeError(f"{content} was answered {response.text}")
            kept.setdefault((begun["person"], place), said)


async def answer_all(
    address: str, people: int, kept: Kept, meanwhile: Callable[[], object] = int
) -> None:
    """Let people answer side by side, and something happen to the server meanwhile."""
    limits = httpx.Limits(max_connections=people)
    async with httpx.AsyncClient(base_url=address, timeout=120, limits=limits) as web:
        everybody = [participate(web, number, kept) for number in range(people)]
        await asyncio.gather(asyncio.to_thread(meanwhile), *everybody)


@dataclass
class Answers:
    """Answers that were acknowledged, and those that the study holds.

    Parameters
    ----------
    kept : the first acknowledged verdict by participant and place
    held : (participant, place, verdict) of every row of the study
    lost_at_kills : acknowledged answers that the file did not hold after a kill
    """

    kept: Kept = field(default_factory=dict)
    held: list[tuple[str, int, bool]] = field(default_factory=list)
    lost_at_kills: int = 0

    def read(self, study: Path) -> None:
        """Read what the study holds."""
        opened = Study(study)
        self.held = [(a.person, a.place, a.real) for a in opened.answers()]
        opened.close()

    @property
    def lost(self) -> int:
        """Acknowledged answers that are not there, now or after a kill."""
        found = {(person, place) for person, place, _ in self.held}
        return self.lost_at_kills + len(set(self.kept) - found)

    @property
    def doubled(self) -> int:
        """Rows beside the first of a participant's place."""
        return len(self.held) - len({(person, place) for person, place, _ in self.held})

    @property
    def changed(self) -> int:
        """Answers with another verdict than the acknowledged one."""
        return sum(self.kept.get((p, place), real) != real for p, place, real in self.held)


def answer_through_kills(study: Path, people: int, shares: list[float]) -> Answers:
    """Let people answer while the server is killed -9 and started again.

    Parameters
    ----------
    shares : of all answers, after which it is killed, ascending; it is stopped after the last
    """
    answers, port = Answers(), free_port()

    def serve_until(share: float) -> None:
        with served(study, port) as (_, process):
            wait_until(lambda: len(answers.kept) >= share * people * PER_PERSON, PATIENCE_S)
            process.send_signal(signal.SIGKILL)
            process.wait()
        # Nobody writes now: what was acknowledged so far must stand already.
        acknowledged = dict(answers.kept)
        answers.read(study)
        found = {(person, place): real for person, place, real in answers.held}
        answers.lost_at_kills += sum(found.get(k) != real for k, real in acknowledged.items())

    def serve_again_and_again() -> None:
        for share in (*shares, 1.0):
            serve_until(share)

    address = f"http://127.0.0.1:{port}"
    asyncio.run(answer_all(address, people, answers.kept, serve_again_and_again))
    return answers


def connect(address: str) -> socket.socket:
    """Open a connection."""
    url = urlsplit(address)
    return socket.create_connection((url.hostname, url.port), timeout=120)


def send_megabytes(web: socket.socket, headers: str, count: int) -> bytes:
    """Send a request of so many megabytes; return what the server says, if it says anything."""
    chunk = b"x" * MEGABYTE
    if "chunked" in headers:
        chunk = b"%x\r\n%b\r\n" % (len(chunk), chunk)
    kind = "Content-Type: application/json"
    web.sendall(f"POST /answer HTTP/1.1\r\nHost: s\r\n{kind}\r\n{headers}\r\n".encode())
    with suppress(ConnectionError):
        for _ in range(count):
            web.sendall(chunk)
    with suppress(ConnectionError):
        return web.recv(100)
    return b""


def memory_growth(study: Path) -> tuple[int, list[bytes]]:
    """Send half a gigabyte in one request of each kind.

    Returns
    -------
    bytes by which the server's peak grew; the statuses that it said, empty where it closed
    """
    said = []
    with served(study) as (address, process):
        for _ in range(20):
            httpx.post(f"{address}/answer", json={})
        before = peak_memory(process.pid)
        for headers in BODIES.values():
            with connect(address) as web:
                # The rest of a refused request may reset the connection before its answer is read.
                said.append(b"".join(send_megabytes(web, headers, 500).split(b" ")[1:2]))
        growth = peak_memory(process.pid) - before
        if httpx.get(address).status_code != 200:
            raise RuntimeError("the server answers no longer")
    return growth, said


def raise_file_limit(wanted: int) -> int:
    """Let this process open more files if the system allows it; return how many it may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    allowed = wanted if hard == resource.RLIM_INFINITY else min(hard, wanted)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, allowed), hard))
    return max(soft, allowed)


def open_connections(begun: bytes) -> Callable[[str, threading.Event], None]:
    """Return an attack that keeps opening connections, each with the start of a request."""

    def attack(address: str, stop: threading.Event) -> None:
        with ExitStack() as opened:
            while not stop.is_set():
                for _ in range(N_HALF_OPEN):
                    with suppress(OSError):  # more than this process may open: it starts again
                        web = opened.enter_context(connect(address))
                        web.sendall(begun)
                    if stop.is_set():
                        return
                opened.close()

    return attack


def begin_again_and_again(address: str, stop: threading.Event) -> None:
    """Attack: begin participations as fast as the server answers."""
    with httpx.Client(base_url=address, timeout=60) as web:
        while not stop.is_set():
            with suppress(httpx.TransportError):
                web.post("/begin", json={"consent": True})


START = "POST /answer HTTP/1.1\r\nHost: s\r\n"
ATTACKS: dict[str, Callable[[str, threading.Event], None]] = {
    "half_open": open_connections(START.encode() + b"Content-Le"),
    "bodies": open_connections(f"{START}Content-Length: 900\r\n\r\n".encode()),
    "begins": begin_again_and_again,
}


@contextmanager
def under_attack(attack: Callable[[str, threading.Event], None], address: str) -> Iterator[None]:
    """Attack from two threads while the block runs."""
    stop = threading.Event()
    threads = [threading.Thread(target=attack, args=(address, stop)) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def kept_out(study: Path, attack: Callable[[str, threading.Event], None], seconds: float) -> float:
    """Take part from another address during an attack; return the longest wait in seconds.

    A connection that is not open after ``RELOAD`` is tried again, as by a person who reloads.
    """
    transport = httpx.HTTPTransport(local_address=OTHER)
    longest = 0.0
    with (
        served(study, 0, *LIMITS) as (address, _),
        httpx.Client(base_url=address, timeout=RELOAD, transport=transport) as web,
        under_attack(attack, address),
    ):
        person = ""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            start = time.monotonic()
            if not person:
                person = _insist(web, "POST", "/begin", {"consent": True}).json()["person"]
            content = {"person": person, "place": 0, "real": True}
            _insist(web, "GET", "/", None)
            _insist(web, "POST", "/answer", content)
            longest = max(longest, time.monotonic() - start)
            time.sleep(0.5)  # as a person does: not faster than the server allows
    return longest


def _insist(web: httpx.Client, method: str, path: str, content: object) -> httpx.Response:
    while True:
        with suppress(httpx.TransportError):
            response = web.request(method, path, json=content)
            if response.status_code == 200:
                return response
        time.sleep(0.1)


def main() -> None:
    """Serve, kill, attack, classify and print."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--people", type=int, default=300)
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--clips", type=int, default=200, help="clips that are classified")
    options = parser.parse_args()
    choice = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        shares = sorted(choice.uniform(0.02, 0.98) for _ in range(options.kills))
        study = small_study(folder / "answers.sqlite")
        answers = answer_through_kills(study, options.people, shares)
        figures: dict[str, float] = {
            "participants": len({person for person, _, _ in answers.held}),
            "answers": len(answers.held),
            "kills": options.kills,
            "lost": answers.lost,
            "doubled": answers.doubled,
            "changed": answers.changed,
        }
        growth, said = memory_growth(small_study(folder / "memory.sqlite"))
        figures |= {"sent_mb": 500, "growth_mb": growth / MEGABYTE}
        figures["accepted_bodies"] = sum(status == b"200" for status in said)
        figures["open_files"] = raise_file_limit(2 * N_HALF_OPEN + 500)
        for name, attack in ATTACKS.items():
            figures[f"kept_out_s_{name}"] = kept_out(
                small_study(folder / f"{name}.sqlite"), attack, ATTACK_S
            )
        clips, reactions = write_clips(folder, options.clips, options.seed)
        figures |= classify(clips, reactions, options.clips, options.seed)
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
