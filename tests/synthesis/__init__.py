"""The embedded default: bodies, motions, contacts, camera, names, distribution of reactions."""
