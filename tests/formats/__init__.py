"""Raw formats: files that are right, files that are wrong, and real ones."""
