"""When: Prefect flows that run the stages."""
