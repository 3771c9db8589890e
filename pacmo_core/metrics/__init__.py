"""Metrics of generated reactions, with floors and intervals."""
