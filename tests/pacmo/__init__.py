"""Tests of pacmo_core.pacmo."""
