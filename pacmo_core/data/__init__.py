"""Motion data: skeletons, interactions, names, coordinates, quality, splits."""
