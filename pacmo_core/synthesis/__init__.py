"""The embedded default: two-person captures whose law of reaction is known."""

from pacmo_core.synthesis.capture import capture, perform, react_oracle
from pacmo_core.synthesis.script import ACTS, Script, file_name, write_script, write_scripts

__all__ = [
    "ACTS",
    "Script",
    "capture",
    "file_name",
    "perform",
    "react_oracle",
    "write_script",
    "write_scripts",
]
