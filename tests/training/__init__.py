"""Tests of the training that every model shares."""
