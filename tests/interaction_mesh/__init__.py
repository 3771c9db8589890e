"""Tests of InteractionMesh."""
