"""Tests of pacmo_core.finish."""
