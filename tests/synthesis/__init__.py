"""The embedded default: bodies, motions, contacts, camera, names, and the distribution of reactions."""
