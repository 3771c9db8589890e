"""The embedded default: synthetic two-person captures whose conditional distribution is known."""

from pacmo_core.synthesis.capture import sample_interaction, sample_motion, sample_oracle_reaction
from pacmo_core.synthesis.script import ACTIONS, Script, file_name, sample_script, sample_scripts

__all__ = [
    "ACTIONS",
    "Script",
    "file_name",
    "sample_interaction",
    "sample_motion",
    "sample_oracle_reaction",
    "sample_script",
    "sample_scripts",
]
