"""Plots, tables and the self-contained 3-D player of reports and commands."""

from pacmo_core.figures.curves import Curve
from pacmo_core.figures.report import DataSummary, QuarantineRow, Report, Section, render_report
from pacmo_core.figures.tables import markdown_table
from pacmo_core.figures.viewer import Panel, PlayedClip

__all__ = [
    "Curve",
    "DataSummary",
    "Panel",
    "PlayedClip",
    "QuarantineRow",
    "Report",
    "Section",
    "markdown_table",
    "render_report",
]
