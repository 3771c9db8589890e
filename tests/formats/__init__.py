"""The readers and writers of raw captures."""
