"""Metrics of generated reactions, with noise floors and bootstrap intervals."""
