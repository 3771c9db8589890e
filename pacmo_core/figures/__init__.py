"""Plots and the self-contained player that report and apps share."""

from pacmo_core.figures.clips import Panel, PlayedClip
from pacmo_core.figures.curves import Curve
from pacmo_core.figures.report import DataSummary, QuarantineRow, Report, Section, render_report
from pacmo_core.figures.tables import markdown_table

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
