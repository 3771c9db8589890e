"""Tests of pacmo_core/project."""
