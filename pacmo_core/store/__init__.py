"""Parquet: schema, read, write, stream."""
