"""Reaction generation: PaCMO's conditional WGAN, baselines, feature networks and inference."""
