"""Pictures: what stands in them, not how they look."""
