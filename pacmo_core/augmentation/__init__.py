"""Augmentation of two-person motions: target bodies, batches of retargeting, acceptance."""
