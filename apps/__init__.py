"""The door: what a person runs by hand."""
