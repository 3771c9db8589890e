"""Tests of the metrics of generated reactions."""
