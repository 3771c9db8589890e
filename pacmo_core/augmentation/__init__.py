"""Variations of interactions: which bodies to give them, and how to make many of them."""
