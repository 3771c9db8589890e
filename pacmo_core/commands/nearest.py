"""The names that are nearest to one that does not exist, for messages."""

import difflib
from collections.abc import Iterable

_MOST = 3


def nearest_names(name: str, known: Iterable[str]) -> list[str]:
    """Return the names that begin with a name, else those that resemble it; at most three."""
    names = sorted(known)
    longer = [other for other in names if other.startswith(name)]
    return longer[:_MOST] or difflib.get_close_matches(name, names, n=_MOST)


def nearest_first(name: str, known: Iterable[str]) -> str:
    """List the known names for a message, those that resemble a name first."""
    names = list(known)
    near = nearest_names(name, names)
    return ", ".join([*near, *(other for other in names if other not in near)])
