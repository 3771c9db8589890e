"""Which: one module a DVC stage."""
