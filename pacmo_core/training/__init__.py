"""Training that every model shares: the loop, optimisation, checkpoints, devices."""
