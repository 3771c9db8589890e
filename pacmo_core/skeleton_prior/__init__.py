"""Skeleton priors: variational autoencoders (VAEs) that retarget a two-person motion to skeletons.

After Li et al. (2024), *Two-person interaction augmentation with skeleton priors*. A skeleton prior
is trained on variations that the InteractionMesh solver made, and generates variations on given or
sampled skeletons in one forward pass. Tables and equations cited here are those of its supplement.
"""
