"""What the tests of one download share: a file, a patience, and ways to get or to stop."""

import hashlib

import httpx
import pytest

from pacmo_core.commands.download import PartialFile, RetryPolicy, download
from tests.commands.site import Site

CONTENT = b"".join(hashlib.sha256(bytes([i])).digest() for i in range(256)) * 64  # 512 KiB
PATIENCE = RetryPolicy(attempts=3, first_wait=0.0, timeout=5.0)


def get(url: str, part: PartialFile) -> None:
    with httpx.Client(trust_env=False, follow_redirects=True, timeout=5.0) as client:
        download(client, f"{url}/a.zip", part, PATIENCE, lambda done, total: None)


def stop_after(site: Site, part: PartialFile, n_bytes: int) -> None:
    """Leave a part of about ``n_bytes`` behind, as a run that is killed would."""

    def killed(done: int, total: int | None) -> None:
        if done >= n_bytes:
            raise KeyboardInterrupt

    with httpx.Client(trust_env=False, timeout=5.0) as client, pytest.raises(KeyboardInterrupt):
        download(client, f"{site.url}/a.zip", part, PATIENCE, killed)
    assert 0 < part.size < len(CONTENT)
