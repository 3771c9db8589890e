"""Where a command works: files that the user names are where the user stands, the rest is not.

``./run pacmo`` stays in the user's folder and names the project's in ``PACMO_PROJECT``. Without the
variable the present folder is the project's.
"""

import os
from pathlib import Path

PROJECT_VARIABLE = "PACMO_PROJECT"


def in_project(path: Path) -> Path:
    """Return a path of the project: as it is where the command runs in the project's root."""
    root = os.environ.get(PROJECT_VARIABLE)
    return path if not root or Path(root).resolve() == Path.cwd() else Path(root) / path


def enter_project() -> None:
    """Change to the project's root, for a command that works on the whole of it."""
    os.chdir(os.environ.get(PROJECT_VARIABLE) or ".")
