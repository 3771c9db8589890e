"""The embedded default: bodies, motions, contacts, camera, names, and the law of reaction."""
