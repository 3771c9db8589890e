"""The library: two-person motion as arrays, from raw captures to models and metrics."""
