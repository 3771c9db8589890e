"""Prefect flows that run the DVC stages, and the supervisor that starts them."""
