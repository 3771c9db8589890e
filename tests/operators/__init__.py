"""Tests of pacmo_core.operators."""
