"""Raw captures in: one module a format."""
