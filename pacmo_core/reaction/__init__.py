"""PaCMO: generator, critic, auto-encoder, GRU baseline, fitting and reacting."""
