"""Tests of pacmo_core.skeleton_prior."""
