"""Plots and the self-contained player that report and apps share."""
