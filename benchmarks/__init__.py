"""Figures against peers, each printed as JSON."""
