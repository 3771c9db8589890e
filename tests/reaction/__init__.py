"""Tests of pacmo_core.reaction."""
