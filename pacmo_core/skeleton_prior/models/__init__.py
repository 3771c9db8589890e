"""One module per skeleton-prior model; ``pacmo_core.models`` lists them by name."""
