"""Motion VAEs, one module per model; ``pacmo_core.models`` lists them by name."""
